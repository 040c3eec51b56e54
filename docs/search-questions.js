// The search of the manual needs every word of a query on a page. A question has words that no answer has ("how do I
// open the gripper?"). If nothing is found, the search is repeated here without them.
const [SEARCH, FOUND] = [2, 3]; // types of the messages to and from the worker of the search
const LEFT_OUT = new Set(
  "a an am and are be can could did do does for has have how i if is it its me my of our please should so that the there this to us was we what when where which who will with would you your".split(" "),
);
const post = Worker.prototype.postMessage;
const newest = new WeakMap(); // the newest query of each worker

function withoutQuestionWords(input) {
  const kept = input.split(/[\s?!.,;:]+/).filter((word) => word && !LEFT_OUT.has(word.toLowerCase()));
  return kept.join(" ");
}

function searchAgain({ target, data: { type, data: found } }) {
  const message = newest.get(target);
  newest.delete(target); // it is repeated once
  if (type !== FOUND || !message || found?.items?.length !== 0) return;
  const input = withoutQuestionWords(message.data.input);
  if (input) post.call(target, { ...message, data: { ...message.data, input } });
}

Worker.prototype.postMessage = function (message, ...more) {
  if (message?.type === SEARCH && message.data?.input) {
    newest.set(this, message);
    this.addEventListener("message", searchAgain); // the same function is added once
  }
  post.call(this, message, ...more);
};

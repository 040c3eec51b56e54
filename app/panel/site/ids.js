// Ids stand in addresses and programs; labels are for people.
export const ID = /^[A-Za-z0-9_.-]{1,64}$/;

// What the label has of a to z and 0 to 9, and an end that makes it unique.
export function idOf(label, otherwise) {
  const plain = label.normalize("NFKD").replace(/\p{M}+/gu, "").toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-+|-+$/g, "");
  return `${plain.slice(0, 48) || otherwise}-${crypto.getRandomValues(new Uint32Array(1))[0].toString(36)}`;
}

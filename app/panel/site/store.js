// What this browser keeps. What is not what was kept, or cannot be read at all, is as if there were nothing.

export function keptText(storage, key) {
  try {
    return globalThis[storage].getItem(key);
  } catch {
    return null;
  }
}

export function keptList(storage, key) {
  try {
    const found = JSON.parse(keptText(storage, key));
    return Array.isArray(found) ? found : [];
  } catch {
    return [];
  }
}

// A full or forbidden storage is no reason not to go on.
export function keep(storage, key, text) {
  try {
    globalThis[storage].setItem(key, text);
  } catch { /* it is there until the page is closed */ }
}

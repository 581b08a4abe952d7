// What this browser keeps: settings for every session, and by what the server recognises the page and the phone.

export const kept = (() => {
  try {
    return JSON.parse(localStorage.getItem('cairn-settings')) ?? {};
  } catch {
    return {};
  }
})();

let changed = () => {};

// `act` is called after each change.
export function whenKept(act) {
  changed = act;
}

// What another address of the same server goes on with.
export const settings = () => Object.fromEntries(Object.entries(kept).filter(([name]) => !['phone', 'key'].includes(name)));

// This is the phone of that token and these settings.
export function adopt(phone, others) {
  Object.assign(kept, others);
  keep('phone', phone);
  location.reload();
}

export function keep(name, value) {
  kept[name] = value;
  try {
    localStorage.setItem('cairn-settings', JSON.stringify(kept));
  } catch {
    // A private window stores nothing.
  }
  changed();
}

// Known only to this page, so that it regains its walk after a network failure or a reload.
function secretOfThisPage() {
  const fresh = [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, '0')).join('');
  try {
    const kept = sessionStorage.getItem('cairn-secret') ?? fresh;
    sessionStorage.setItem('cairn-secret', kept);
    return kept;
  } catch {
    return fresh;
  }
}
export const secret = secretOfThisPage();

// The token of this phone, the same in every session: the server keeps its lens, its route and its settings by it.
function phoneOfThisBrowser() {
  if (typeof kept.phone !== 'string') keep('phone', [...crypto.getRandomValues(new Uint8Array(8))].map((b) => b.toString(16).padStart(2, '0')).join(''));
  return kept.phone;
}
export const phone = phoneOfThisBrowser();

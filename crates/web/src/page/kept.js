// What this browser keeps: settings for every session, and by what the server recognises the page and the phone.

export const kept = (() => {
  try {
    return JSON.parse(localStorage.getItem('cairn-settings')) ?? {};
  } catch {
    return {};
  }
})();

export function keep(name, value) {
  kept[name] = value;
  try {
    localStorage.setItem('cairn-settings', JSON.stringify(kept));
  } catch {
    // A private window stores nothing.
  }
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

// The same for this browser in every session: the server keeps the lens of the phone by it.
function phoneOfThisBrowser() {
  if (typeof kept.phone !== 'string') keep('phone', [...crypto.getRandomValues(new Uint8Array(8))].map((b) => b.toString(16).padStart(2, '0')).join(''));
  return kept.phone;
}
export const phone = phoneOfThisBrowser();

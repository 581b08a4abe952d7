// How a phone comes to trust this computer: the steps on the page, read aloud where that is wished.

const $ = (id) => document.getElementById(id);
// The part of the walker's device: its steps alone are read.
const isApple = () => /iPhone|iPad|iPod|Macintosh/.test(navigator.userAgent);

export class Trust {
  // `say` speaks a text, `t` gives the page's sentences.
  constructor(say, t) {
    Object.assign(this, { t, authority: null });
    $('trust-say').addEventListener('click', () => say(this.steps()));
  }

  // The steps in the language of the page; nothing where the server has no authority.
  show(authority) {
    this.authority = authority;
    $('trust-part').hidden = !authority;
    if (!authority) return;
    $('trust-on').textContent = this.t('page-trust-ios-on', authority);
    $('trust-compare').textContent = this.t('page-trust-compare', authority);
  }

  // The steps for this device as one text. The fingerprint is to be compared by eye or screen reader.
  steps() {
    const list = document.querySelectorAll('#trust ol')[isApple() ? 0 : 1];
    const words = (item) => (item.querySelector('span') ?? item).textContent;
    return [...list.children].map((item, k) => `${k + 1}. ${words(item)}`).join(' ');
  }

  // The browser refused the web socket: the steps are unfolded, and what is to be said about it is returned, both once.
  refused() {
    if (this.told) return null;
    this.told = true;
    if (this.authority) $('trust').open = true;
    return this.authority ? 'page-trust-how' : 'page-trust-slow';
  }
}

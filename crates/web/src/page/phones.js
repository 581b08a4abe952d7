// The server does not know this phone: whether it is one that was here from another address, asked once.
import { adopt, keep, kept } from './kept.js';

const $ = (id) => document.getElementById(id);

export class KnownPhones {
  // `say` speaks a text, `t` gives the page's sentences.
  constructor({ say, t }) {
    Object.assign(this, { say, t, phones: [] });
    $('known-yes').addEventListener('click', () => adopt(this.phones[0].phone, this.phones[0].settings));
    $('known-no').addEventListener('click', () => {
      this.phones.shift();
      this.ask();
    });
    $('known').addEventListener('cancel', (event) => event.preventDefault());
  }

  // The phones that it may be, the newest first.
  take(phones) {
    if (kept.isNew || $('known').open) return;
    this.phones = phones;
    $('known').showModal();
    this.ask();
  }

  ask() {
    if (this.phones.length === 0) {
      keep('isNew', true);
      $('known').close();
      return;
    }
    const [number, name] = this.phones[0].route;
    $('known-words').textContent = this.t(name ? 'page-known-named' : 'page-known', { number, name });
    this.say($('known-words').textContent);
  }
}

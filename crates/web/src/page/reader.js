// Whether the walker uses a screen reader, asked at the first start: then the page writes for it, and does not speak over it.
import { kept } from './kept.js';

const $ = (id) => document.getElementById(id);

export class Reader {
  // `say` speaks a text, `t` gives the page's sentences.
  constructor({ say, t }) {
    for (const [id, told] of [['reader-yes', 'reader'], ['reader-no', 'voice']]) {
      $(id).addEventListener('click', () => {
        const radio = document.querySelector(`[name=told][value=${told}]`);
        radio.checked = true;
        radio.dispatchEvent(new Event('change'));
        $('reader').close();
        this.answered();
      });
    }
    $('reader').addEventListener('cancel', (event) => event.preventDefault());
    // A browser speaks only once the page was touched: until then a screen reader reads the dialog.
    $('reader').addEventListener('pointerdown', () => say(t('page-reader-ask')), { once: true });
  }

  // Resolves once the answer is known.
  ask() {
    if (kept.told) return Promise.resolve();
    $('reader').showModal();
    return new Promise((done) => { this.answered = done; });
  }
}

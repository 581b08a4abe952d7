// What to mind before walking: spoken once at the first start of this browser, confirmed once, and again on request.
import { keep, kept } from './kept.js';

const $ = (id) => document.getElementById(id);
const SENTENCES = ['page-before-aid', 'page-before-streets', 'page-before-obstacles', 'page-before-untried', 'page-before-pictures'];

export class Before {
  constructor(senses, t) {
    Object.assign(this, { senses, t });
    $('before-say').addEventListener('click', () => this.say());
    $('before-again').addEventListener('click', () => {
      $('before').showModal();
      this.say();
    });
    $('before-heard').addEventListener('click', () => {
      keep('before', true);
      senses.drop('before');
      $('before').close();
    });
    // Escape does not confirm.
    $('before').addEventListener('cancel', (event) => event.preventDefault());
  }

  // At the first start. A browser speaks only once the page was touched: until then a screen reader reads the dialog.
  first() {
    if (kept.before) return;
    $('before').showModal();
    $('before').addEventListener('pointerdown', () => this.say(), { once: true });
  }

  say() {
    this.senses.wake();
    this.senses.say({ text: SENTENCES.map((id) => this.t(id)).join(' '), priority: 1, kind: 'before' });
  }
}

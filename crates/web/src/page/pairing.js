// Pairs a phone that has no key: the computer says six digits, and who types them is given the key.

const $ = (id) => document.getElementById(id);

export class Pairing {
  // `say` speaks a text, `t` gives the page's sentences, `language` its language; `paired` takes the key.
  constructor({ say, t, language, paired }) {
    Object.assign(this, { say, t, language, paired });
    $('pairing').querySelector('form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.ask({ digits: $('pair-digits').value.replace(/\D/g, '') });
    });
    $('pair-again').addEventListener('click', () => this.ask({}));
    // Without a key there is nothing else to do here.
    $('pairing').addEventListener('cancel', (event) => event.preventDefault());
  }

  open() {
    if ($('pairing').open) return;
    $('pairing').showModal();
    this.ask({});
  }

  async ask(question) {
    const sent = fetch('pair', { method: 'POST', body: JSON.stringify({ language: this.language(), ...question }) });
    const answer = await sent.then((got) => got.json()).catch(() => ({ offline: true }));
    const [kind, value] = Object.entries(answer)[0];
    if (kind === 'key') {
      $('pairing').close();
      this.paired(value);
      return;
    }
    const id = { said: 'page-pair-said', wait: 'page-pair-wait', wrong: value === 0 ? 'page-pair-over' : 'page-pair-wrong', offline: 'page-pair-offline' }[kind];
    $('pair-words').textContent = this.t(id, { seconds: value });
    $('pair-digits').value = '';
    $('pair-digits').focus();
    this.say($('pair-words').textContent);
  }
}

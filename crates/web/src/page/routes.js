// The kept routes: their list with its buttons, the dialogs about them, and the one main button of the walk.

// A button whose meaning has just changed ignores a press that was meant for the meaning before.
const CHANGED_MS = 500;

const $ = (id) => document.getElementById(id);

function make(kind, properties, ...inside) {
  const element = Object.assign(document.createElement(kind), properties);
  element.append(...inside);
  return element;
}

// The list of the routes, newest first.
export class RouteList {
  // `command` takes a line, `t` gives the page's sentences.
  constructor(command, t) {
    Object.assign(this, { command, t, routes: [], shown: '', may: false });
    $('rename').querySelector('form').addEventListener('submit', (event) => {
      event.preventDefault();
      const name = $('rename-name').value.trim();
      $('rename').close();
      if (name) command(`rename ${this.renaming} ${name}`);
    });
    $('rename-leave').addEventListener('click', () => $('rename').close());
    for (const [id, line] of [['question-yes', 'yes'], ['question-no', 'no']]) {
      $(id).addEventListener('click', () => { $('question').close(); command(line); });
    }
    $('question').addEventListener('cancel', () => command('no'));
  }

  take(routes) {
    const text = JSON.stringify(routes);
    if (text === this.shown) return;
    this.shown = text;
    this.routes = routes;
    this.show();
  }

  // Whether this page may give commands now: it holds the walk, or nobody does.
  allow(may) {
    if (may === this.may) return;
    this.may = may;
    this.show();
  }

  // The list in the language of the page.
  show() {
    $('routes-count').textContent = this.t('page-routes-count', { count: this.routes.length });
    $('routes-none').hidden = this.routes.length > 0;
    // A list that is rebuilt keeps the focus where it was.
    const focus = document.activeElement?.dataset?.route;
    $('route-list').replaceChildren(...this.routes.map((route) => this.item(route)));
    if (focus) document.querySelector(`[data-route="${CSS.escape(focus)}"]`)?.focus();
  }

  item(route) {
    const { t } = this;
    const button = (id, what, action) => {
      const made = make('button', { type: 'button', textContent: t(id) });
      made.setAttribute('aria-label', t('page-labelled', { action: t(id), route: route.words }));
      made.dataset.route = `${what} ${route.number}`;
      if (!this.may) made.setAttribute('aria-disabled', 'true');
      made.addEventListener('click', action);
      return made;
    };
    const load = button('page-load-one', 'load', () => this.command(`load ${route.number}`));
    if (route.why_not) load.setAttribute('aria-disabled', 'true');
    const rename = button('page-rename', 'rename', () => {
      this.renaming = route.number;
      $('rename-title').textContent = route.words;
      $('rename-name').value = route.name ?? '';
      $('rename').showModal();
      $('rename-name').select();
    });
    const remove = button('page-delete', 'delete', () => this.command(`delete ${route.number}`));
    remove.classList.add('halt');
    const more = [];
    if (route.loaded) more.push(t('page-route-loaded'));
    if (route.notes) more.push(t('page-notes-count', { count: route.notes }));
    if (route.why_not) more.push(t('page-why-not', { why: route.why_not }));
    const item = make('li', {}, make('p', { className: 'name', textContent: route.words }));
    if (more.length) item.append(make('p', { className: 'more', textContent: more.join(' ') }));
    item.append(make('div', { className: 'three' }, load, rename, remove));
    if (!route.why_not) {
      const there = (id, end) => {
        const made = button(id, `take-${end}`, () => this.command(`take me to route ${route.number} ${end}`));
        made.classList.add('go');
        return made;
      };
      item.append(make('div', { className: 'two' }, there('page-take-me-start', 'start'), there('page-take-me-end', 'end')));
    }
    item.classList.toggle('loaded', route.loaded);
    return item;
  }

  // A question of the session is asked on the page that holds the walk, and taken back with its reason.
  ask(question, controls) {
    const open = $('question').open;
    if (question && controls && this.asked !== question) {
      $('question-words').textContent = question;
      if (!open) $('question').showModal();
    } else if (!question && open) $('question').close();
    this.asked = question;
  }
}

// A landmark: the place is that of the moment at which the dialog opens.
export class Noting {
  // `voices` records and keeps notes in the walker's own voice; `refused` says what failed.
  constructor(command, voices, t, refused) {
    Object.assign(this, { command, voices, t, refused, clip: null });
    $('noting-voice').hidden = !window.MediaRecorder;
    $('noting-voice').addEventListener('click', () => this.record());
    $('noting').addEventListener('close', () => voices.end());
    $('note').addEventListener('click', () => this.open());
    $('noting-leave').addEventListener('click', () => $('noting').close());
    $('noting').querySelector('form').addEventListener('submit', (event) => {
      event.preventDefault();
      const side = document.querySelector('[name=side]:checked').value;
      $('noting').close();
      const named = this.clip && this.clip[0] === $('noting-text').value.trim();
      if (named) voices.keep(...this.clip).catch(() => refused(t('page-note-voice-lost')));
      command(`note ${side} ${$('noting-text').value.trim()}`.replace(/\s+/g, ' ').trim());
    });
  }

  open() {
    if ($('note').hidden || $('noting').open) return;
    this.command('mark');
    this.clip = null;
    this.show();
    $('noting-text').value = '';
    $('side-none').checked = true;
    $('noting').showModal();
  }

  // The first press begins, the next ends; what was recorded has a name by which the guide says it.
  async record() {
    if (this.voices.recorder) {
      this.voices.end();
      return;
    }
    try {
      await this.voices.begin((clip) => {
        this.clip = [this.t('page-note-voice-name', { number: this.voices.next() }), clip];
        [$('noting-text').value] = this.clip;
        this.show();
      });
      this.show();
    } catch {
      this.refused(this.t('page-note-voice-refused'));
    }
  }

  show() {
    const id = this.voices.recorder?.state === 'recording' ? 'page-note-voice-end' : this.clip ? 'page-note-voice-again' : 'page-note-voice';
    $('noting-voice').textContent = this.t(id);
  }
}

// The main button: what most likely comes next.
export class MainButton {
  constructor(t) {
    this.t = t;
    this.changed = -Infinity;
    this.isCommanded = false;
    $('main').addEventListener('click', (event) => {
      if (performance.now() - this.changed < CHANGED_MS) event.stopPropagation();
    });
  }

  // The walker has given a command: the button may mean something else now.
  commanded() {
    this.isCommanded = true;
  }

  // `status` is null before the first picture. What ends by itself leaves the button as it is: a press that comes then ends nothing
  // and begins nothing.
  show(status, shown) {
    const button = $('main');
    const next = !status || status.frames === 0 ? 'wait' : status.recording ? 'stop' : status.guiding?.state === 'paused' ? 'resume' : status.guiding ? 'halt'
      : status.route?.here ? (status.route.is_new ? 'home' : 'again') : 'record';
    const stays = ['stop', 'halt'].includes(button.dataset.state) && next !== 'wait' && !this.isCommanded;
    const state = stays ? button.dataset.state : next;
    const [command, label] = {
      wait: ['status', 'page-wait-picture'], record: ['record', 'page-record'], stop: ['stop', 'page-stop'],
      halt: ['halt', 'page-halt'], resume: ['resume', 'page-resume'], home: ['guide', 'page-guide-home'], again: ['guide again', 'page-guide-again'],
    }[state];
    button.hidden = !shown;
    if (button.dataset.state !== state) {
      this.changed = performance.now();
      this.isCommanded = false;
      button.dataset.state = state;
      button.dataset.command = command;
    }
    this.write(button, label);
    const length = status?.recording && status.metric && status.recording.length >= 1
      ? `, ${Math.round(status.recording.length)} m` : '';
    const more = button.querySelector('.more');
    if (more.textContent !== length) more.textContent = length;
    $('note').hidden = !status?.recording || !shown;
    $('pause').hidden = !shown || !status?.guiding || status.guiding.state === 'paused';
    const other = { home: ['guide again', 'page-guide-again'], again: ['guide', 'page-guide-home'], resume: ['halt', 'page-halt'] }[state];
    $('other').hidden = !other || !shown;
    if (other) {
      $('other').dataset.command = other[0];
      this.write($('other'), other[1]);
    }
    $('anew').hidden = $('other').hidden || state === 'resume';
  }

  // Text is set only when it changes, so that a screen reader keeps its position.
  write(button, id) {
    const label = button.querySelector('.label');
    label.dataset.text = id;
    if (label.textContent !== this.t(id)) label.textContent = this.t(id);
  }
}

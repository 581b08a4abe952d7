// The buttons of a headset and of the lock screen (Media Session): play and pause say the last words again, stop halts
// guidance. A browser gives them only to a page that plays sound, so a silent one is played while this is on; no device
// but the one that holds the walk should do so.

const ACTIONS = { play: 'repeat', pause: 'repeat', previoustrack: 'repeat', nexttrack: 'status', stop: 'halt' };

// Two seconds of silence: WAV, 8 bits, 8000 samples a second.
function silence() {
  const samples = 16000;
  const data = new DataView(new ArrayBuffer(44 + samples));
  const text = (at, letters) => [...letters].forEach((c, i) => data.setUint8(at + i, c.charCodeAt(0)));
  text(0, 'RIFF'); text(8, 'WAVE'); text(12, 'fmt '); text(36, 'data');
  [[4, 36 + samples], [16, 16], [24, 8000], [28, 8000], [40, samples]].forEach(([at, n]) => data.setUint32(at, n, true));
  [[20, 1], [22, 1], [32, 1], [34, 8]].forEach(([at, n]) => data.setUint16(at, n, true));
  for (let k = 0; k < samples; k += 1) data.setUint8(44 + k, 128);
  return new Blob([data.buffer], { type: 'audio/wav' });
}

export class MediaButtons {
  // `command` is called with the line of a command.
  constructor(command, t) {
    this.command = command;
    this.t = t;
    this.sound = null;
  }

  // Must be turned on from a tap or a key press: browsers play no sound before.
  set(on) {
    const session = navigator.mediaSession;
    if (!session) return;
    for (const [action, line] of Object.entries(ACTIONS)) {
      try {
        session.setActionHandler(action, on ? () => this.press(line) : null);
      } catch {
        // A browser that does not know the action.
      }
    }
    if (on && !this.sound) {
      this.sound = new Audio(URL.createObjectURL(silence()));
      this.sound.loop = true;
    }
    if (on) {
      session.metadata = new MediaMetadata({ title: 'Cairn', artist: this.t('page-guidance-label') });
      this.sound.play().catch(() => {});
    } else this.sound?.pause();
  }

  press(line) {
    this.command(line);
    // The browser takes a press of "pause" as the end of the sound, and would give no further one.
    if (this.sound?.paused) this.sound.play().catch(() => {});
    navigator.mediaSession.playbackState = 'playing';
  }
}

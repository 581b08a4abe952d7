// What a walker who sees neither the battery nor the light is told: that one runs low, and that it is too dark for the camera.

// The battery is announced once at each of these shares.
const LEVELS = [0.2, 0.1, 0.05];
// Grays of a picture, of 255: darker than this for so many looks in a row is dark, and lighter than the second is light again. The
// darkest of 462 pictures of a phone, two cameras in halls, a car and a kitchen has 71.
const [DARK, LIGHT, LOOKS] = [20, 30, 3];

export async function watchBattery(say, t, battery = navigator.getBattery?.()) {
  const power = await battery;
  if (!power) return;
  let told = Infinity;
  const look = () => {
    const level = power.charging ? undefined : LEVELS.findLast((share) => power.level <= share);
    if (level < told) say(t('page-battery', { percent: Math.round(100 * power.level) }));
    told = level ?? Infinity;
  };
  power.addEventListener('levelchange', look);
  power.addEventListener('chargingchange', look);
  look();
}

export class Light {
  constructor(say, t) {
    Object.assign(this, { say, t, isDark: false, looks: 0 });
  }

  // The mean gray of a picture, once a second.
  look(gray) {
    const differs = this.isDark ? gray > LIGHT : gray < DARK;
    this.looks = differs ? this.looks + 1 : 0;
    if (this.looks < LOOKS) return;
    [this.isDark, this.looks] = [!this.isDark, 0];
    this.say(this.t(this.isDark ? 'page-dark-now' : 'page-light-now'));
  }
}

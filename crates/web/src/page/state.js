// The table of the state: the texts of its lines, by their ids.

// Minutes and seconds.
export function clock(s) {
  return `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, '0')}`;
}

export function table(s, words) {
  const t = (id, values) => words.text(id, values);
  const number = (value, decimals = 1) => words.number(value, decimals);
  const g = s.guiding;
  const size = t('page-map-size', { places: s.key_frames, points: s.landmarks });
  return {
    's-tracking': s.words,
    's-phase': s.waits.length ? t('page-waits', { phase: s.phase, waits: s.waits.join(', ') }) : s.phase,
    's-imu': t(s.engine.imu ? 'page-imu' : 'page-not-used'),
    's-recording': recordingText(s.recording, s.metric, words),
    's-route': s.route ? t(s.route.here ? 'page-route' : 'page-route-elsewhere', { ...s.route, file: s.route.name }) : t('page-none'),
    's-guiding': g ? t(s.metric ? 'page-guiding-metres' : 'page-guiding', {
      facing: g.facing, state: g.state.split(' ')[0], along: number(g.along_m), length: number(g.length_m),
    }) : t('page-none'),
    's-scale': t(s.metric ? 'page-metres' : 'page-no-scale'),
    's-map': s.map_trouble ? t('page-map-not-saved', { map: size, why: s.map_trouble }) : size,
    's-time': t('page-time', { clock: clock(s.t_s) }),
  };
}

function recordingText(recording, metric, words) {
  const t = (id, values) => words.text(id, values);
  if (!recording) return t('page-no');
  const { file, trouble: why } = recording;
  const recorded = t(metric ? 'page-recorded' : 'page-recorded-units', { file, length: words.number(recording.length, 1) });
  return why ? t('page-not-on-disk', { recorded, why }) : recorded;
}

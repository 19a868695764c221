// The dashboard: requests /status twice a second and shows it. Its own state is the history of the
// charts, the changes that can be undone, and choices of the viewer.

import { calibrate } from './calibrate.js';
import { remember, spark } from './charts.js';
import { buildColumns } from './columns.js';
import { exposure } from './exposure.js';
import { guide } from './guide.js';
import { health, healthUnknown } from './health.js';
import { lamps } from './lamps.js';
import { buildLog, log } from './log.js';
import { buildObjects, objects } from './objects.js';
import { buildPicture, openStream, picture } from './picture.js';
import { buildPlayback, playback } from './playback.js';
import { buildPlanes, planes } from './planes.js';
import { buildPresets, presets } from './presets.js';
import { recording } from './recording.js';
import { buildScenes, scenes } from './scenes.js';
import { buildSettings, settings } from './settings.js';
import { buildTheme } from './theme.js';
import { $, age, duration, facts, flag, make, millis, number, percent, put, refill, whole } from './text.js';

const POLL_MS = 500;
const RETRY_MS = 1500;
const ENVIRONMENT_MS = 1000;

const DEVICE_STATES = {
  absent: 'idle', opening: 'warn', streaming: 'good', silent: 'warn', retrying: 'bad', failed: 'bad', ended: 'idle',
};
const DEVICE_KINDS = {
  'scene-camera': 'Scene camera', 'environment-camera': 'Environment camera', tracker: 'Tracker',
};
const STAGES = {
  decode: 'Decode pictures', environment: 'Estimate lighting', upload: 'Upload',
  composite: 'Composite', encode: 'Encode for browsers', total: 'Whole frame',
  arrival_to_picture: 'From arrival to picture',
};
const METHODS = {
  chart: 'Colour chart', automatic: 'Automatic', 'known-surface': 'Known surface',
  'grey-world': 'Grey world', 'same-camera': 'One camera', 'same-model': 'One model', configured: 'Config file', none: 'None',
};
const METHOD_TEXTS = {
  chart: 'Matched with pictures of one colour chart taken by both cameras.',
  automatic: 'Matched with surfaces that both cameras see.',
  'known-surface': 'Matched with a surface whose colour is known.',
  'grey-world': 'Guess: the scene is assumed to be grey on average.',
  'same-model': 'Both cameras are of one model; their exposures alone differ.',
  'same-camera': 'One camera sees the scene and its light; no match is needed.',
  configured: 'Matched with the factors written in the config file.',
  none: 'The cameras are not matched.',
};

// ── cards ───────────────────────────────────────────────────────────────────────────

const stageOf = (s, name) => s.stages.find((stage) => stage.name === name && stage.kind === 'cpu');

function head(s) {
  put($('session-name'), s.session.name || 'no session');
  document.title = s.session.name ? `${s.session.name} – Penumbra` : 'Penumbra';
  put($('head-fps'), number(s.frames.per_second));
  put($('head-ms'), number(stageOf(s, 'total')?.recent_ms));
  put($('head-lights'), whole(s.lighting.dome_lights));
  const { resident_bytes: used, limit_bytes: limit } = s.program.memory;
  const megabytes = (bytes) => whole(Math.round(bytes / 1e6));
  const memory = used === null ? '' : `, ${megabytes(used)}${limit === null ? '' : ` of ${megabytes(limit)}`} MB of memory`;
  put($('program'), `${s.program.name} ${s.program.version}, up ${duration(s.program.uptime_seconds)}${memory}`);
  const a = s.adapter;
  put($('adapter'), a.name ? `Rendered at ${s.quality} quality by ${a.name} (${a.backend}, ${a.kind})${a.losses ? `, lost ${whole(a.losses)} times` : ''}` : '');
}

function warnings(s) {
  $('warnings-card').hidden = !s.warnings.length;
  const text = ({ text: t, count }) => (count > 1 ? `${t} (${whole(count)} times)` : t);
  refill($('warnings'), s.warnings.map(text), (t) => make('li', '', t));
}

function devices(s) {
  if (!s.devices.length) return;
  refill($('devices'), s.devices.map((d) => [d.name, d.kind, d.state, d.reason, d.identity, d.mode, d.notes, d.controls]), deviceItem);
  s.devices.forEach((d, i) => {
    const lost = d.dropped ? `, ${whole(d.dropped)} lost` : ', none lost';
    const last = d.last_age_ms === null ? '' : `, last ${age(d.last_age_ms)} ago`;
    const line = d.received ? `${number(d.per_second)} per second, ${whole(d.received)} in total${lost}${last}` : '';
    const tries = d.losses || d.attempts > 1 ? `opened ${whole(d.attempts)} times, lost ${whole(d.losses)} times` : '';
    put($('devices').children[i].querySelector('.rate'), [line, tries].filter(Boolean).join('; '));
    put($('devices').children[i].querySelector('.description'), d.description);
  });
}

function deviceItem([name, kind, state, reason, identity, mode, notes, controls]) {
  const item = make('li');
  const badge = make('span', 'pill', state);
  const tone = DEVICE_STATES[state] ?? 'idle';
  badge.dataset.tone = tone === 'good' && reason ? 'warn' : tone;
  const title = make('b', '', DEVICE_KINDS[kind] ?? kind);
  const what = make('span', 'what muted');
  what.append(make('span', '', `${name} · `), make('span', 'description'));
  item.append(title, badge, what);
  if (reason) item.append(make('span', 'what reason', reason));
  item.append(make('span', 'rate muted'));
  const more = [identity === name ? '' : identity, mode, ...notes].filter(Boolean).join(' · ');
  if (more) item.append(make('span', 'what muted', more));
  controls.forEach((c) => {
    const value = c.active === null ? '' : ` (now ${c.active})`;
    if (c.status !== 'held') item.append(make('span', 'what reason', `${c.name} = ${c.requested}: ${c.status}${value}`));
  });
  return item;
}

let shownRevision = 0;
let shownAt = -Infinity;

function distances(lamps) {
  const each = lamps.map((lamp) => (lamp.distance_m === null ? 'far' : `${lamp.distance_m.toFixed(2)} ± ${lamp.distance_sigma_m.toFixed(2)} m`));
  return each.join(', ') || '–';
}

function agreement(l) {
  if (l.picture_difference === null) return 'not compared: no shadow of a phantom is in view';
  const whole = `${percent(l.picture_difference, 0)} ± ${percent(l.picture_difference_sigma, 0)}`;
  return [whole, ...l.disagreeing].join('; ');
}

function environment(s) {
  const l = s.lighting;
  flag($('light-flag'), l.stale ? `old light: ${l.stale}` : '');
  facts($('light-facts'), [
    ['dome lights', whole(l.dome_lights)],
    ['lights of compact sources', whole(l.compact_lights)],
    ['compact sources', whole(l.compact_sources)],
    ['their distances', distances(l.lamps)],
    ['age of the light', age(l.age_ms)],
    ['environment pictures left out', whole(l.environments_left_out)],
    ['clipped', percent(l.clipped_fraction, 2)],
    ['exposures disagree by', percent(l.exposures_disagree, 0)],
    ['real shadows agree to', agreement(l)],
    ['dominant light, elevation', elevation(l.dominant_direction)],
    ['dominance', percent(l.dominance, 0)],
  ]);
  probe(s);
  const now = performance.now();
  if (l.preview_revision === shownRevision || now - shownAt < ENVIRONMENT_MS) return;
  [shownRevision, shownAt] = [l.preview_revision, now];
  const next = new Image();
  next.onload = () => {
    $('environment').src = next.src;
    $('environment').hidden = false;
    $('environment-note').hidden = true;
  };
  next.src = `/environment.png?revision=${l.preview_revision}`;
  $('environment').alt = `Map of the light from all directions with ${l.dome_lights} dome lights marked`;
}

/** Describes the source of a pose. */
function poseBy(r) {
  const markers = `${whole(r.markers)} marker${r.markers === 1 ? '' : 's'}`;
  if (r.source === 'markers') return markers;
  if (r.source !== 'hybrid') return r.source;
  return `tracker, corrected by markers ${r.corrected_ago_s < 0.2 ? 'now' : `${r.corrected_ago_s.toFixed(1)} s ago`}`;
}

/** Shows the state of the mirrored sphere in the scene camera's picture, and the camera's pose. */
function probe({ lighting, registration: r }) {
  const seen = lighting.probe;
  $('probe-facts').hidden = !seen && r.source !== 'markers' && r.sigma_px === null && r.display === null;
  const ms = (seconds) => (seconds === null ? NaN : seconds * 1000);
  const pixels = (x) => (x === null ? '–' : `${x.toFixed(2)} px`);
  facts($('probe-facts'), [
    ['pose from', poseBy(r)],
    ...(r.sigma_px === null ? [] : [['pose error, 1σ', `${r.sigma_px.toFixed(2)} px, ${r.sigma_mm.toFixed(1)} mm, ${r.sigma_deg.toFixed(2)}°`]]),
    ...(r.correction_mm === null ? [] : [['tracker correction', `${r.correction_mm.toFixed(1)} mm, ${r.correction_deg.toFixed(2)}°`]]),
    ...(r.display === null ? [] : [['predicted', `${r.display.ahead_ms.toFixed(0)} ms ahead, moved ${pixels(r.display.moved_px)}, error ${pixels(r.display.sigma_px)}`]]),
    ['corner error', pixels(r.reprojection_px) + (r.ambiguous ? ', two poses fit' : '')],
    ...(seen ? [
      ['sphere coverage', `${percent(seen.coverage, 0)}, above ${percent(seen.coverage_above, 0)}`],
      ['mean age', `${age(ms(seen.map_age_s))}`],
      ['sphere last seen', `${age(ms(seen.sphere_age_s))} ago`],
      ['rim correction', pixels(seen.rim_shift_px)],
    ] : []),
  ]);
}

/** Formats the elevation of a direction, degrees above the horizon. */
function elevation(d) {
  return d ? `${Math.round((Math.asin(Math.max(-1, Math.min(1, d[2]))) * 180) / Math.PI)}°` : '–';
}

const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * encode(Math.max(0, Math.min(1, x))))).join(' ')})`;

/** Returns the maximum relative difference between the channels of two colours. */
const difference = (a, b) => Math.max(...a.map((x, i) => Math.abs(x / b[i] - 1)));

/** Returns the measured white, or else a grey surface computed from the gains. */
function whites(balance) {
  if (balance.white) return balance.white;
  const scene = [0.45, 0.45, 0.45];
  return { scene, environment_before: scene.map((x, i) => x / balance.gains[i]), environment_after: scene };
}

function balance(s) {
  const b = s.white_balance;
  const disagreement = b.disagreement === null ? '' : ` The methods differ by ${percent(b.disagreement)}.`;
  put($('balance-text'), (METHOD_TEXTS[b.method] ?? '') + disagreement);
  flag($('balance-flag'), b.frozen ? `held: ${b.frozen}` : '');
  const w = whites(b);
  const brightest = Math.max(...w.scene, ...w.environment_before, ...w.environment_after, 1e-6);
  const scale = Math.min(1, 0.9 / brightest);
  const paint = (element, rgb) => { element.style.background = css(rgb.map((x) => x * scale)); };
  document.querySelectorAll('.sw-scene').forEach((element) => paint(element, w.scene));
  paint($('sw-before'), w.environment_before);
  paint($('sw-after'), w.environment_after);
  put($('sw-before-text'), `${percent(difference(w.environment_before, w.scene))} apart`);
  put($('sw-after-text'), b.white ? `${percent(difference(w.environment_after, w.scene))} apart` : 'by definition');
  put($('swatch-caption'), b.white
    ? 'The same white surface: environment camera on the left, scene camera on the right of each pair.'
    : 'A grey surface, computed from the factors below: environment camera on the left, scene camera on the right.');
  gains(b);
}

function gains(b) {
  const rows = b.estimates.map((e) => ({ ...e, used: e.method === b.method }));
  if (!rows.some((r) => r.used)) rows.unshift({ method: b.method, gains: b.gains, uncertainty: b.uncertainty, used: true });
  const key = (r) => [METHODS[r.method] ?? r.method, r.used, ...r.gains.map((g, i) => [number(g, 3), r.uncertainty ? `±${number(100 * r.uncertainty[i], 1)} %` : ''])];
  refill($('gains'), rows.map(key), ([name, used, ...channels]) => {
    const row = make('tr');
    row.toggleAttribute('data-used', used);
    row.append(make('td', '', name));
    for (const [gain, uncertainty] of channels) {
      const cell = make('td', '', `${gain} `);
      cell.append(make('small', '', uncertainty));
      row.append(cell);
    }
    return row;
  });
}

function timing(s) {
  const fps = remember('fps', s.frames.per_second);
  const total = stageOf(s, 'total')?.recent_ms;
  const ms = remember('ms', total);
  put($('fps-now'), number(s.frames.per_second));
  put($('ms-now'), millis(total));
  spark($('fps-chart'), fps, { axis: true });
  spark($('ms-chart'), ms, { axis: true });
  $('fps-chart').ariaLabel = `Frames per second over the last two minutes, now ${number(s.frames.per_second)}`;
  $('ms-chart').ariaLabel = `Milliseconds per frame over the last two minutes, now ${number(total)}`;
  stages(s);
  const p = s.pairing;
  put($('timing-facts'), p.environment_skew_ms === null ? '' :
    `light ${age(Math.abs(p.environment_skew_ms))} ${p.environment_skew_ms < 0 ? 'after' : 'before'} the picture, pose ${p.pose}`);
  const measured = p.tracker_latency_measured_ms === null ? [] : [['tracker latency measured',
    `${millis(p.tracker_latency_measured_ms)} ± ${number(p.tracker_latency_sigma_ms)} (used ${millis(p.tracker_latency_ms)})`]];
  facts($('frame-facts'), [
    ['frames arrived', whole(s.frames.arrived)], ['composited', whole(s.frames.composed)],
    ['skipped', whole(s.frames.skipped)], ['without pose', whole(s.frames.without_pose)],
    ['viewers', whole(s.stream.viewers)], ...measured,
    ...(s.session.progress === null ? [] : [['played', percent(s.session.progress, 0)], ['repetitions', whole(s.session.loops)]]),
  ]);
}

function stages(s) {
  const rows = [...s.stages].sort((a, b) => (a.name === 'total') - (b.name === 'total'));
  refill($('stages'), rows.map((r) => [r.name, r.kind]), stageRow);
  rows.forEach((stage, i) => {
    const row = $('stages').children[i];
    spark(row.querySelector('canvas'), remember(`${stage.kind} ${stage.name}`, stage.recent_ms));
    const figures = [stage.recent_ms, stage.p50_ms, stage.p99_ms];
    figures.forEach((value, j) => put(row.children[2 + j], millis(value)));
  });
}

function stageRow([name, kind]) {
  const row = make('tr');
  row.toggleAttribute('data-total', name === 'total');
  const label = STAGES[name] ?? name.replaceAll('_', ' ').replace(/^./, (c) => c.toUpperCase());
  const history = make('td', 'history');
  const canvas = make('canvas', kind === 'gpu' ? 'cool' : '');
  canvas.ariaHidden = 'true';
  history.append(canvas);
  row.append(make('td', kind, label), history, make('td'), make('td'), make('td'));
  return row;
}

// ── requests ──────────────────────────────────────────────────────────────────────────────

function render(s, askedAt) {
  head(s);
  guide(s);
  health(s);
  log(s);
  picture(s);
  playback(s);
  objects(s);
  settings(s, askedAt);
  presets(s);
  warnings(s);
  planes(s);
  exposure(s);
  scenes(s);
  recording(s.recording);
  devices(s);
  environment(s);
  lamps(s.lighting);
  balance(s);
  timing(s);
}

function connected() {
  if (document.body.dataset.link === 'up') return;
  document.body.dataset.link = 'up';
  flag($('link-lost'), '');
  if (!document.hidden) openStream();
}

function disconnected(reason) {
  document.body.dataset.link = 'lost';
  flag($('link-lost'), reason);
  healthUnknown();
  put($('picture-note'), 'No connection');
  $('picture-note').hidden = false;
}

async function update() {
  const askedAt = performance.now();
  let response;
  try {
    response = await fetch('/status', { signal: AbortSignal.timeout(5000) });
  } catch {
    disconnected('The connection to Penumbra is lost. Is the program still running? Trying again …');
    return false;
  }
  if (response.status === 401) { disconnected('A token is needed: open the address with ?token=… that Penumbra printed.'); return false; }
  if (!response.ok) { disconnected(`Penumbra answers with an error (${response.status}). Trying again …`); return false; }
  const s = await response.json();
  if (s.version !== 1) { disconnected('Penumbra has been updated: reload this page.'); return false; }
  connected();
  render(s, askedAt);
  return true;
}

async function poll() {
  const up = await update();
  setTimeout(poll, up ? POLL_MS : RETRY_MS);
}

buildPicture();
buildPlayback();
buildObjects();
buildSettings();
buildPlanes();
buildPresets();
buildScenes();
buildLog();
buildTheme();
buildColumns();
poll();
calibrate();

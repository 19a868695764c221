// The dashboard: asks /status twice a second and shows what it says. It keeps no truth of
// its own except the history that the charts draw and the wishes that the rig has not
// confirmed yet.

const POLL_MS = 500;
const RETRY_MS = 1500;
const HISTORY = 240; // two minutes
const ENVIRONMENT_MS = 1000;
const CONFIRM_MS = 4000;
const STILL_MS = 3000;

const $ = (id) => document.getElementById(id);
const LIGHT = '#f2b84b';
const COOL = '#6fb2ff';

const STATES = {
  starting: ['getting ready', 'warn'], live: ['live', 'good'], replaying: ['replaying', 'good'],
  paused: ['paused', 'idle'], ended: ['ended', 'idle'], failed: ['failed', 'bad'],
};
const DEVICE_STATES = {
  absent: 'idle', opening: 'warn', streaming: 'good', silent: 'warn', retrying: 'warn', failed: 'bad', ended: 'idle',
};
const DEVICE_KINDS = {
  'scene-camera': 'Scene camera', 'environment-camera': 'Environment camera', tracker: 'Tracker',
};
const STAGES = {
  decode: 'Decode pictures', environment: 'Read the light', upload: 'Upload',
  composite: 'Composite', encode: 'Encode for browsers', total: 'Whole frame',
};
const METHODS = {
  chart: 'Colour chart', automatic: 'Automatic', 'known-surface': 'Known surface',
  configured: 'Config file', none: 'None',
};
const METHOD_TEXTS = {
  chart: 'Matched with pictures of one colour chart taken by both cameras.',
  automatic: 'Matched with what both cameras see of the same surfaces.',
  'known-surface': 'Matched with a surface whose colour is known.',
  configured: 'Matched with the factors written in the config file.',
  none: 'The cameras are not matched: their pictures are taken as they come.',
};
const LIGHTS_HINTS = { adaptive: 'Lamps and sun get their own.', grid: 'Evenly, as in the paper.' };
const SHADOW_HINTS = { ratio: 'Dims the real surface.', subtract: 'Takes light away, as in the paper.' };

// ── small things ────────────────────────────────────────────────────────────────────────

const number = (value, digits = 1) => (Number.isFinite(value) ? value.toFixed(digits) : '–');
const whole = (value) => (Number.isFinite(value) ? Math.round(value).toLocaleString('en') : '–');
const percent = (value, digits = 1) => (Number.isFinite(value) ? `${number(100 * value, digits)} %` : '–');

/** Milliseconds with as many digits as are worth reading. */
function millis(value) {
  if (!Number.isFinite(value)) return '–';
  return `${value.toFixed(value < 10 ? 2 : value < 100 ? 1 : 0)} ms`;
}

function duration(seconds) {
  const s = Math.floor(seconds);
  const [hours, minutes] = [Math.floor(s / 3600), Math.floor(s / 60) % 60];
  if (hours) return `${hours} h ${minutes} min`;
  return minutes ? `${minutes} min ${s % 60} s` : `${s} s`;
}

function age(ms) {
  if (!Number.isFinite(ms)) return '–';
  return ms < 1000 ? `${Math.round(ms)} ms` : `${number(ms / 1000)} s`;
}

/** Writes only what differs, so that nothing flickers and screen readers stay quiet. */
function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function make(tag, className, text) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

function pill(element, text, tone) {
  put(element, text);
  element.dataset.tone = tone;
}

function flag(element, text) {
  element.hidden = !text;
  put(element, text || '');
}

function facts(list, pairs) {
  while (list.children.length > pairs.length) list.lastChild.remove();
  pairs.forEach(([name, value], i) => {
    const row = list.children[i] ?? list.appendChild(make('div'));
    if (!row.children.length) row.append(make('dt'), make('dd'));
    put(row.children[0], name);
    put(row.children[1], value);
  });
}

// ── charts ──────────────────────────────────────────────────────────────────────────────

const histories = new Map();

function remember(key, value) {
  const history = histories.get(key) ?? [];
  history.push(Number.isFinite(value) ? value : NaN);
  if (history.length > HISTORY) history.shift();
  histories.set(key, history);
  return history;
}

/** Prepares a canvas for its size on the screen; null while it is not shown. */
function brush(canvas) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return null;
  const ratio = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}

/** The least of 1, 2, 5 × 10ⁿ that is not below a value. */
function niceAbove(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((m) => m * power).find((m) => m >= value * 0.999) ?? value;
}

function trace(context, history, x, y) {
  context.beginPath();
  let pen = false;
  history.forEach((value, i) => {
    if (Number.isNaN(value)) { pen = false; return; }
    if (pen) context.lineTo(x(i), y(value)); else context.moveTo(x(i), y(value));
    pen = true;
  });
}

function spark(canvas, history, { colour = LIGHT, axis = false } = {}) {
  const surface = brush(canvas);
  if (!surface) return;
  const { context, width, height } = surface;
  const top = niceAbove(Math.max(...history.filter(Number.isFinite), 0) * (axis ? 1.05 : 1));
  const left = axis ? 30 : 0;
  const inset = axis ? 8 : 2;
  const x = (i) => left + ((HISTORY - history.length + i) / (HISTORY - 1)) * (width - left - 2);
  const y = (value) => height - inset - (value / top) * (height - 2 * inset);
  if (axis) grid(context, { left, width, top, y });
  trace(context, history, x, y);
  context.strokeStyle = colour;
  context.lineWidth = axis ? 1.8 : 1.4;
  context.lineJoin = 'round';
  context.stroke();
  const last = history.length - 1;
  if (!Number.isFinite(history[last])) return;
  context.beginPath();
  context.arc(x(last), y(history[last]), axis ? 2.6 : 1.8, 0, 7);
  context.fillStyle = colour;
  context.fill();
}

function grid(context, { left, width, top, y }) {
  context.font = '10px system-ui, sans-serif';
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  context.lineWidth = 1;
  for (const value of [0, top / 2, top]) {
    context.strokeStyle = '#222733';
    context.beginPath();
    context.moveTo(left, Math.round(y(value)) + 0.5);
    context.lineTo(width, Math.round(y(value)) + 0.5);
    context.stroke();
    context.fillStyle = '#7d8695';
    context.fillText(String(Number(value.toPrecision(2))), left - 6, y(value));
  }
}

// ── the picture ─────────────────────────────────────────────────────────────────────────

let streamRound = 0;

/** Opens the stream anew; a broken one does not come back by itself. */
function openStream() {
  streamRound += 1;
  $('picture').src = `/stream.mjpeg?n=${streamRound}`;
}

/** Nobody looks: the rig need not encode. */
function closeStream() {
  $('picture').removeAttribute('src');
}

function picture(s) {
  const { width, height } = s.resolution;
  if (width && height) $('screen').style.aspectRatio = `${width} / ${height}`;
  put($('picture-facts'), width ? `${width} × ${height}` : '');
  const note = $('picture-note');
  const moving = ['live', 'replaying'].includes(s.session.state);
  const still = moving && s.frames.last_age_ms > STILL_MS;
  if (!s.frames.composed) put(note, 'Waiting for the first picture …');
  else if (still) put(note, `No new picture for ${age(s.frames.last_age_ms)}`);
  note.toggleAttribute('data-over', still);
  note.hidden = Boolean(s.frames.composed) && !still;
}

$('full').addEventListener('click', () => $('screen').requestFullscreen?.());
document.addEventListener('visibilitychange', () => {
  if (document.hidden) closeStream();
  else openStream();
});
window.addEventListener('pagehide', closeStream);

// ── settings ────────────────────────────────────────────────────────────────────────────

const form = $('settings');
const wishes = new Map(); // setting → { value, since } until /status confirms it
let sending = 0;

const KINDS = { light_count: Number, shadow_strength: Number };

function fieldsOf(name) {
  const found = form.elements[name];
  return found instanceof RadioNodeList ? [...found] : [found];
}

function valueOf(name) {
  const [field] = fieldsOf(name);
  if (field.type === 'checkbox') return field.checked;
  const text = form.elements[name].value;
  return KINDS[name] ? KINDS[name](text) : text;
}

function show(name, value) {
  const [field] = fieldsOf(name);
  if (field.type === 'checkbox') field.checked = value;
  else form.elements[name].value = String(value);
  if (name === 'shadow_strength') put($('strength-text'), percent(value, 0));
  if (name === 'lights_mode') put($('lights-hint'), LIGHTS_HINTS[value] ?? '');
  if (name === 'shadow_mode') put($('shadow-hint'), SHADOW_HINTS[value] ?? '');
}

const same = (a, b) => (typeof a === 'number' ? Math.abs(a - b) < 1e-4 : a === b);

function settings(inForce) {
  const now = performance.now();
  for (const [name, value] of Object.entries(inForce)) {
    if (!form.elements[name]) continue;
    const wish = wishes.get(name);
    if (wish && (same(wish.value, value) || now - wish.since > CONFIRM_MS)) wishes.delete(name);
    const waiting = wishes.has(name);
    if (!waiting) show(name, value);
    fieldsOf(name).forEach((f) => f.closest('.row').toggleAttribute('data-pending', waiting));
    if (wish && !waiting && !same(wish.value, value)) say('The rig has not taken this setting.');
  }
  if (!wishes.size && $('adjust-note').textContent === 'Applying …') say('');
}

function say(text) {
  put($('adjust-note'), text);
}

async function send(name) {
  const value = valueOf(name);
  wishes.set(name, { value, since: performance.now() });
  show(name, value);
  say('Applying …');
  const turn = ++sending;
  try {
    const response = await fetch('/settings', {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ [name]: value }),
    });
    if (!response.ok) throw new Error((await response.json()).error);
  } catch (error) {
    wishes.delete(name);
    if (turn === sending) say(error.message);
  }
}

let sliding;
form.addEventListener('input', (event) => {
  const { name } = event.target;
  if (!name) return;
  clearTimeout(sliding);
  if (event.target.type !== 'range') { send(name); return; }
  wishes.set(name, { value: valueOf(name), since: performance.now() });
  show(name, valueOf(name));
  sliding = setTimeout(send, 120, name);
});
form.addEventListener('submit', (event) => event.preventDefault());

// ── the cards ───────────────────────────────────────────────────────────────────────────

const stageOf = (s, name) => s.stages.find((stage) => stage.name === name && stage.kind === 'cpu');

function head(s) {
  const [word, tone] = STATES[s.session.state] ?? [s.session.state, 'idle'];
  pill($('state-pill'), word, tone);
  put($('state-sentence'), s.session.sentence);
  put($('session-name'), s.session.name || 'no session');
  document.title = s.session.name ? `${s.session.name} – Penumbra` : 'Penumbra';
  put($('head-fps'), number(s.frames.per_second));
  put($('head-ms'), number(stageOf(s, 'total')?.recent_ms));
  put($('head-lights'), whole(s.lighting.dome_lights));
  put($('program'), `${s.program.name} ${s.program.version}, up ${duration(s.program.uptime_seconds)}`);
  const a = s.adapter;
  put($('adapter'), a.name ? `Drawn by ${a.name} (${a.backend}, ${a.kind})` : '');
}

function warnings(s) {
  $('warnings-card').hidden = !s.warnings.length;
  const text = ({ text: t, count }) => (count > 1 ? `${t} (${whole(count)} times)` : t);
  refill($('warnings'), s.warnings.map(text), (t) => make('li', '', t));
}

/** Rebuilds a list only when what it says has changed. */
function refill(list, keys, build) {
  const key = JSON.stringify(keys);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...keys.map(build));
}

function devices(s) {
  if (!s.devices.length) return;
  refill($('devices'), s.devices.map((d) => [d.name, d.kind, d.state, d.reason]), deviceItem);
  s.devices.forEach((d, i) => {
    const lost = d.dropped ? `, ${whole(d.dropped)} lost` : ', none lost';
    const heard = d.last_age_ms === null ? '' : `, last ${age(d.last_age_ms)} ago`;
    const line = d.received ? `${number(d.per_second)} per second, ${whole(d.received)} in all${lost}${heard}` : '';
    put($('devices').children[i].querySelector('.rate'), line);
    put($('devices').children[i].querySelector('.sentence'), d.sentence);
  });
}

function deviceItem([name, kind, state, reason]) {
  const item = make('li');
  const badge = make('span', 'pill', state);
  badge.dataset.tone = DEVICE_STATES[state] ?? 'idle';
  const title = make('b', '', DEVICE_KINDS[kind] ?? kind);
  const what = make('span', 'what muted');
  what.append(make('span', '', `${name} · `), make('span', 'sentence'));
  item.append(title, badge, what);
  if (reason) item.append(make('span', 'what reason', reason));
  item.append(make('span', 'rate muted'));
  return item;
}

let shownRevision = 0;
let shownAt = -Infinity;

function environment(s) {
  const l = s.lighting;
  flag($('light-flag'), l.stale ? `old light: ${l.stale}` : '');
  facts($('light-facts'), [
    ['dome lights', whole(l.dome_lights)],
    ['of them for lamps and sun', whole(l.compact_lights)],
    ['lamps, windows, sun found', whole(l.compact_sources)],
    ['age of the light', age(l.age_ms)],
    ['seen clipped', percent(l.clipped_fraction, 2)],
    ['brightest from', direction(l.dominant_direction)],
  ]);
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
  $('environment').alt = `Map of the light from all directions with ${l.dome_lights} dome lights drawn on it`;
}

/** Height above the horizon and bearing from +X towards +Y. */
function direction(d) {
  if (!d) return '–';
  const up = Math.round((Math.asin(Math.max(-1, Math.min(1, d[2]))) * 180) / Math.PI);
  const around = Math.round((Math.atan2(d[1], d[0]) * 180) / Math.PI + 360) % 360;
  return `${up}° up, ${around}° round`;
}

const encode = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);
const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * encode(Math.max(0, Math.min(1, x))))).join(' ')})`;

/** Largest relative difference between the channels of two colours. */
const apart = (a, b) => Math.max(...a.map((x, i) => Math.abs(x / b[i] - 1)));

/** Without a measured white, the gains say how a grey would look. */
function whites(balance) {
  if (balance.white) return balance.white;
  const scene = [0.45, 0.45, 0.45];
  return { scene, environment_before: scene.map((x, i) => x / balance.gains[i]), environment_after: scene };
}

function balance(s) {
  const b = s.white_balance;
  const agree = b.disagreement === null ? '' : ` The methods agree to ${percent(b.disagreement)}.`;
  put($('balance-text'), (METHOD_TEXTS[b.method] ?? '') + agree);
  flag($('balance-flag'), b.frozen ? `held: ${b.frozen}` : '');
  const w = whites(b);
  const brightest = Math.max(...w.scene, ...w.environment_before, ...w.environment_after, 1e-6);
  const scale = Math.min(1, 0.9 / brightest);
  const paint = (element, rgb) => { element.style.background = css(rgb.map((x) => x * scale)); };
  document.querySelectorAll('.sw-scene').forEach((element) => paint(element, w.scene));
  paint($('sw-before'), w.environment_before);
  paint($('sw-after'), w.environment_after);
  put($('sw-before-text'), `${percent(apart(w.environment_before, w.scene))} apart`);
  put($('sw-after-text'), b.white ? `${percent(apart(w.environment_after, w.scene))} apart` : 'by definition');
  put($('swatch-caption'), b.white
    ? 'The same white surface: environment camera on the left, scene camera on the right of each pair.'
    : 'How a grey surface looks, from the factors below: environment camera on the left, scene camera on the right.');
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
    for (const [gain, spread] of channels) {
      const cell = make('td', '', `${gain} `);
      cell.append(make('small', '', spread));
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
  spark($('ms-chart'), ms, { axis: true, colour: COOL });
  $('fps-chart').ariaLabel = `Frames per second over the last two minutes, now ${number(s.frames.per_second)}`;
  $('ms-chart').ariaLabel = `Milliseconds per frame over the last two minutes, now ${number(total)}`;
  stages(s);
  const p = s.pairing;
  put($('timing-facts'), p.environment_skew_ms === null ? '' :
    `light ${age(p.environment_skew_ms)} before the picture, pose ${p.pose}`);
  facts($('frame-facts'), [
    ['frames arrived', whole(s.frames.arrived)], ['composited', whole(s.frames.composed)],
    ['skipped', whole(s.frames.skipped)], ['without pose', whole(s.frames.without_pose)],
    ['watching', whole(s.stream.viewers)],
    ...(s.session.progress === null ? [] : [['played', percent(s.session.progress, 0)], ['rounds', whole(s.session.loops)]]),
  ]);
}

function stages(s) {
  const rows = [...s.stages].sort((a, b) => (a.name === 'total') - (b.name === 'total'));
  refill($('stages'), rows.map((r) => [r.name, r.kind]), stageRow);
  rows.forEach((stage, i) => {
    const row = $('stages').children[i];
    const colour = stage.kind === 'gpu' ? COOL : LIGHT;
    spark(row.querySelector('canvas'), remember(`${stage.kind} ${stage.name}`, stage.recent_ms), { colour });
    const figures = [stage.recent_ms, stage.p50_ms, stage.p99_ms];
    figures.forEach((value, j) => put(row.children[2 + j], millis(value)));
  });
}

function stageRow([name, kind]) {
  const row = make('tr');
  row.toggleAttribute('data-total', name === 'total');
  const label = STAGES[name] ?? name.replaceAll('_', ' ').replace(/^./, (c) => c.toUpperCase());
  const history = make('td', 'history');
  const canvas = make('canvas');
  canvas.ariaHidden = 'true';
  history.append(canvas);
  row.append(make('td', kind, label), history, make('td'), make('td'), make('td'));
  return row;
}

// ── asking ──────────────────────────────────────────────────────────────────────────────

function render(s) {
  head(s);
  picture(s);
  settings(s.settings);
  warnings(s);
  devices(s);
  environment(s);
  balance(s);
  timing(s);
}

function linked() {
  if (document.body.dataset.link === 'up') return;
  document.body.dataset.link = 'up';
  flag($('link-lost'), '');
  if (!document.hidden) openStream();
}

function lost(reason) {
  document.body.dataset.link = 'lost';
  flag($('link-lost'), reason);
  pill($('state-pill'), 'no connection', 'bad');
  put($('state-sentence'), '');
}

async function ask() {
  let response;
  try {
    response = await fetch('/status', { signal: AbortSignal.timeout(5000) });
  } catch {
    lost('The connection to Penumbra is lost. Is the program still running? Trying again …');
    return false;
  }
  if (response.status === 401) { lost('A token is needed: open the address with ?token=… that Penumbra printed.'); return false; }
  if (!response.ok) { lost(`Penumbra answers with an error (${response.status}). Trying again …`); return false; }
  const s = await response.json();
  if (s.version !== 1) { lost('Penumbra has been updated: reload this page.'); return false; }
  linked();
  render(s);
  return true;
}

async function poll() {
  const up = await ask();
  setTimeout(poll, up ? POLL_MS : RETRY_MS);
}

poll();

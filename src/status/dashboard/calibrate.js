// Calibration: requests /calibration, shows the step's picture with overlay points, and sends
// requests. The state is the server's: a page may be opened at any time.

import { $, duration, facts, flag, make, percent, pill, put, refill, whole } from './text.js';

const BUSY_MS = 250;
const IDLE_MS = 2000;
const CROSS = 4; // half the size of a cross, pixels in a picture of 640

const STATES = {
  unavailable: ['live only', 'idle'], idle: ['ready', 'idle'], running: ['running', 'warn'],
  evaluating: ['evaluating', 'warn'], finished: ['finished', 'good'], failed: ['failed', 'bad'],
};
const GRADES = { good: 'good', usable: 'warn', refused: 'bad' };

let view = null;
let timer = 0;
let revision = 0;
let loading = false;

const busy = () => ['running', 'evaluating'].includes(view?.state);

// ── form ─────────────────────────────────────────────────────────────────

/** Builds one row of the form. */
function field(parameter) {
  const row = make('label', 'row');
  const label = make('span', 'label', parameter.label);
  if (parameter.hint) label.append(make('small', '', parameter.hint));
  const input = make(parameter.choices.length ? 'select' : 'input');
  if (parameter.choices.length) {
    parameter.choices.forEach(([value, text]) => input.append(new Option(text, value)));
  } else {
    input.type = 'text';
    input.maxLength = 200;
    input.spellcheck = false;
  }
  input.name = parameter.name;
  const before = view.step === chosen()?.name ? view.parameters[parameter.name] : null;
  input.value = before ?? parameter.default;
  row.append(label, input);
  return row;
}

const chosen = () => view?.steps.find((step) => step.name === $('calibrate-step').value);

function form() {
  const select = $('calibrate-step');
  const before = select.value;
  refill(select, view.steps.map((step) => [step.title, step.name]), ([title, name]) => new Option(title, name));
  if (!before && view.step) select.value = view.step;
  const step = chosen();
  put($('calibrate-about'), step?.about ?? '');
  refill($('calibrate-parameters'), step?.parameters ?? [], field);
}

function request() {
  const parameters = {};
  $('calibrate-parameters').querySelectorAll('[name]').forEach((input) => { parameters[input.name] = input.value; });
  const seconds = $('calibrate-seconds').valueAsNumber;
  return { step: chosen()?.name ?? '', parameters, seconds: Number.isFinite(seconds) ? seconds : null };
}

// ── state ─────────────────────────────────────────────────────────────────────────

function run() {
  const evaluating = view.state === 'evaluating';
  put($('calibrate-title'), view.title);
  const bar = $('calibrate-share');
  if (evaluating) bar.removeAttribute('value');
  else bar.value = view.share;
  put($('calibrate-percent'), evaluating ? '' : percent(view.share, 0));
  put($('calibrate-message'), view.message);
  put($('calibrate-hint'), evaluating ? '' : hint(view.hint));
  flag($('calibrate-waits'), view.device_error);
  facts($('calibrate-facts'), [
    ['duration', duration(view.seconds)],
    ['pictures used', whole(view.pictures)],
    ...(view.skipped ? [['skipped', whole(view.skipped)]] : []),
    ...(view.damaged ? [['damaged', whole(view.damaged)]] : []),
    ...(view.readings_lost ? [['readings lost', whole(view.readings_lost)]] : []),
  ]);
  $('calibrate-finish').disabled = evaluating;
}

const hint = (text) => text.replace(/^./, (c) => c.toUpperCase());

function result() {
  const r = busy() ? null : view.result;
  $('calibrate-result').hidden = !r;
  if (!r) return;
  put($('calibrate-of'), view.title);
  pill($('calibrate-grade'), r.grade, GRADES[r.grade] ?? 'idle');
  $('calibrate-report').hidden = !r.report;
  refill($('calibrate-figures'), r.lines, (line) => make('li', '', line));
  const findings = r.findings.map(({ grade, text }) => [grade, GRADES[grade], text]);
  const next = r.hints.map((text) => ['next', 'idle', hint(text)]);
  refill($('calibrate-findings'), [...findings, ...next], ([word, tone, text]) => {
    const item = make('li');
    const badge = make('span', 'pill', word);
    badge.dataset.tone = tone ?? 'idle';
    item.append(badge, make('span', '', text));
    return item;
  });
  const files = [['Written to', r.file], ['Previous file kept as', r.backup]].filter(([, file]) => file);
  refill($('calibrate-files'), files, ([what, file]) => make('li', '', `${what} ${file}`));
}

/** Draws crosses at the detected points, in pixels of the picture. */
function overlay({ width, height, points }) {
  const svg = $('calibrate-marks');
  svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
  const size = (CROSS * Math.max(width, height)) / 640;
  const cross = ([x, y]) => `M${x + 0.5 - size} ${y + 0.5}h${2 * size}M${x + 0.5} ${y + 0.5 - size}v${2 * size}`;
  const path = points.map(cross).join('');
  svg.querySelectorAll('path').forEach((element) => element.setAttribute('d', path));
}

/** Changes the picture and its points together. */
function picture() {
  const shown = view.picture;
  const note = $('calibrate-note');
  note.hidden = Boolean(shown) && revision > 0;
  $('calibrate-screen').hidden = !shown && !busy();
  if (!shown) {
    revision = 0;
    $('calibrate-picture').hidden = true;
    overlay({ width: 1, height: 1, points: [] });
    return;
  }
  if (shown.revision === revision || loading || document.hidden) return;
  const next = new Image();
  loading = true;
  next.onload = () => {
    loading = false;
    revision = shown.revision;
    const image = $('calibrate-picture');
    image.src = next.src;
    image.alt = `Picture of the ${shown.camera} camera with ${shown.points.length} points found`;
    image.hidden = false;
    note.hidden = true;
    $('calibrate-screen').style.aspectRatio = `${shown.width} / ${shown.height}`;
    overlay(shown);
  };
  next.onerror = () => { loading = false; };
  next.src = `/calibration/picture.jpg?revision=${shown.revision}`;
}

function render() {
  $('calibrate-card').hidden = false;
  const [word, tone] = STATES[view.state] ?? [view.state, 'idle'];
  const grade = view.state === 'finished' ? view.result?.grade : null;
  pill($('calibrate-pill'), word, GRADES[grade] ?? tone);
  const failed = view.state === 'failed';
  put($('calibrate-description'), failed || busy() ? '' : view.description);
  $('calibrate-body').hidden = view.state === 'unavailable';
  if (view.state === 'unavailable') return;
  $('calibrate-form').hidden = busy() || !view.steps.length;
  $('calibrate-run').hidden = !busy();
  if (failed) flag($('calibrate-trouble'), view.description);
  if (busy()) run();
  else form();
  result();
  picture();
}

// ── requests ──────────────────────────────────────────────────────────────────────────────

async function poll() {
  clearTimeout(timer);
  // A lost connection is reported by the page already.
  if (document.body.dataset.link === 'up') {
    try {
      const response = await fetch('/calibration', { signal: AbortSignal.timeout(5000) });
      if (response.ok) { view = await response.json(); render(); }
    } catch { /* the next request may succeed */ }
  }
  clearTimeout(timer);
  timer = setTimeout(poll, busy() && !document.hidden ? BUSY_MS : view ? IDLE_MS : BUSY_MS);
}

/** Sends a request and shows the reason of a refusal. */
async function send(what, body) {
  flag($('calibrate-trouble'), '');
  try {
    const response = await fetch(`/calibration/${what}`, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify(body),
    });
    const answer = await response.json().catch(() => ({}));
    if (!response.ok) throw new Error(answer.error ?? `Penumbra answers with an error (${response.status}).`);
    view = answer;
    render();
  } catch (error) {
    flag($('calibrate-trouble'), error.message.replace(/^calibration: /, ''));
  }
  poll();
}

/** Starts polling. */
export function calibrate() {
  $('calibrate-form').addEventListener('submit', (event) => { event.preventDefault(); send('start', request()); });
  $('calibrate-step').addEventListener('change', form);
  $('calibrate-finish').addEventListener('click', () => send('finish', {}));
  $('calibrate-abort').addEventListener('click', () => send('abort', {}));
  poll();
}

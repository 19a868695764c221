// The settings. What a control shows is the rig's: the value that was requested last, marked until
// a picture uses it. Nothing is assumed after a time. A refused change says why beside its control,
// which returns to the rig's value.

import { DAILY, RESEARCH } from './controls.js';
import { buildRow } from './rows.js';
import { $, flag, put } from './text.js';
import { post } from './requests.js';

const SLIDE_MS = 120;
const MAX_UNDO = 100;

const form = $('settings');
const controls = new Map(); // name → control; see `add`
let status = null; // the newest status
const done = []; // changes that can be undone: { before, after }
const undone = [];

const same = (a, b) => (typeof a === 'number' ? Math.abs(a - b) < 1e-6 : a === b);

function add(definition, place) {
  const row = buildRow(definition);
  place.append(row);
  controls.set(definition.name, {
    ...definition,
    row,
    fields: [...row.querySelectorAll(`[name=${definition.name}]`)],
    timer: 0, // runs while a slider moves
    sending: false, // a request is under way
    changed: false, // the value has changed since that request
    answeredAt: -Infinity, // an older status is not yet aware of the request
    entry: null, // its change in `done`, while it is being made
  });
}

function valueOf({ kind, number, fields }) {
  if (kind === 'switch') return fields[0].checked;
  const text = kind === 'choice' ? fields.find((f) => f.checked)?.value : fields[0].value;
  return kind === 'slider' || number ? Number(text) : text;
}

function show(control, value) {
  const { kind, fields, name, format } = control;
  if (kind === 'switch') fields[0].checked = value;
  else if (kind === 'choice') fields.forEach((f) => { f.checked = f.value === String(value); });
  else if (kind !== 'slider' || !same(Number(fields[0].value), value)) fields[0].value = String(value);
  if (format) put($(`${name}-text`), format(value));
}

/** Shows the state of every control. `askedAt` is when the status was requested. */
export function settings(s, askedAt) {
  status = s;
  const waiting = [];
  for (const control of controls.values()) {
    const { name, row } = control;
    const requested = s.settings_requested[name];
    const own = control.timer || control.sending || askedAt < control.answeredAt;
    if (!own) show(control, requested);
    const isWaiting = Boolean(own) || !same(requested, s.settings[name]);
    row.toggleAttribute('data-pending', isWaiting);
    if (isWaiting) waiting.push(control.label);
  }
  const reason = closedBecause(s);
  $('settings-body').disabled = Boolean(reason);
  put($('adjust-note'), reason || (waiting.length ? `With the next picture: ${waiting.join(', ')}` : ''));
  buttons();
}

/** Returns why no setting can take effect; empty if they can. */
function closedBecause({ session }) {
  if (session.state === 'ended') return 'The recording has ended; start it again to change settings.';
  if (session.state === 'failed') return 'The rig has stopped; settings have no effect.';
  return '';
}

function buttons() {
  const closed = $('settings-body').disabled;
  $('undo').disabled = closed || !done.length;
  $('redo').disabled = closed || !undone.length;
  $('reset').disabled = closed || !status || !Object.keys(toConfigured()).length;
}

/** Returns the values that differ from the configuration's. */
function toConfigured() {
  const { settings_configured: configured, settings_requested: requested } = status;
  return Object.fromEntries(Object.entries(configured).filter(([name, value]) => !same(requested[name], value)));
}

// ── changes ───────────────────────────────────────────────────────────────────────────

/** Remembers a change for undo. The steps of one slide are one change. */
function remember(control) {
  const { name } = control;
  if (!control.entry) {
    control.entry = { before: { [name]: status.settings_requested[name] }, after: {} };
    done.push(control.entry);
    if (done.length > MAX_UNDO) done.shift();
    undone.length = 0;
  }
  control.entry.after[name] = valueOf(control);
}

function forget(control) {
  const at = done.indexOf(control.entry);
  if (at >= 0) done.splice(at, 1);
}

/** Sends a control's value; each control has its own request and its own delay. */
async function send(control) {
  control.timer = 0;
  if (control.sending) { control.changed = true; return; }
  control.sending = true;
  flag(trouble(control), '');
  const { name } = control;
  try {
    const requested = await post('/settings', { [name]: valueOf(control) });
    status.settings_requested = requested;
  } catch (error) {
    forget(control);
    if (!control.timer && !control.changed) show(control, status.settings_requested[name]);
    flag(trouble(control), error.message.replace(`${name}: `, ''));
  }
  control.answeredAt = performance.now();
  control.sending = false;
  if (control.changed) {
    control.changed = false;
    send(control);
  } else if (!control.timer) {
    control.entry = null;
  }
  buttons();
}

const trouble = ({ name }) => $(`${name}-trouble`);

/** Sends several values at once; returns whether the rig took them. */
async function sendAll(change) {
  const named = Object.keys(change).map((name) => controls.get(name)).filter(Boolean);
  named.forEach((control) => { clearTimeout(control.timer); control.timer = 0; control.entry = null; flag(trouble(control), ''); });
  flag($('settings-trouble'), '');
  try {
    status.settings_requested = await post('/settings', change);
  } catch (error) {
    flag($('settings-trouble'), error.message);
    return false;
  }
  named.forEach((control) => {
    control.answeredAt = performance.now();
    show(control, status.settings_requested[control.name]);
    control.row.setAttribute('data-pending', '');
  });
  return true;
}

/** Applies a set of values as one change, which can be undone. */
export async function apply(change) {
  if (!status) return false;
  const before = Object.fromEntries(Object.keys(change).map((name) => [name, status.settings_requested[name]]));
  if (!await sendAll(change)) return false;
  done.push({ before, after: change });
  undone.length = 0;
  buttons();
  return true;
}

async function step(from, to, which) {
  const entry = from.pop();
  if (!entry) return;
  if (await sendAll(entry[which])) to.push(entry);
  buttons();
}

/** Returns the values requested last, of the controls on this page. */
export function values() {
  return Object.fromEntries([...controls.keys()].map((name) => [name, status?.settings_requested[name]]));
}

// ── events ────────────────────────────────────────────────────────────────────────────

function input(event) {
  const control = controls.get(event.target.name);
  if (!control || !status) return;
  remember(control);
  show(control, valueOf(control));
  control.row.setAttribute('data-pending', '');
  clearTimeout(control.timer);
  if (control.kind === 'slider') control.timer = setTimeout(send, SLIDE_MS, control);
  else send(control);
}

function keys(event) {
  if (!(event.ctrlKey || event.metaKey) || event.target.matches('input[type=text], input[type=number], textarea')) return;
  const key = event.key.toLowerCase();
  if (key !== 'z' && key !== 'y') return;
  event.preventDefault();
  if (key === 'y' || event.shiftKey) step(undone, done, 'after');
  else step(done, undone, 'before');
}

/** Builds the controls. */
export function buildSettings() {
  DAILY.forEach((definition) => add(definition, $('daily')));
  RESEARCH.forEach((definition) => add(definition, $('research')));
  form.addEventListener('input', input);
  form.addEventListener('submit', (event) => event.preventDefault());
  document.addEventListener('keydown', keys);
  $('undo').addEventListener('click', () => step(done, undone, 'before'));
  $('redo').addEventListener('click', () => step(undone, done, 'after'));
  $('reset').addEventListener('click', () => apply(toConfigured()));
}

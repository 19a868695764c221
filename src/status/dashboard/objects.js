// Virtual objects are picked and moved on the picture, turned and scaled beside it. The rig casts the
// rays, because it knows the lens and the camera's pose.

import { post } from './requests.js';
import { $, flag, put, refill } from './text.js';

const STEP_M = 0.01;
const SEND_MS = 40;
const GESTURE_MS = 1000; // changes of a kind that follow one another within this time are one move
const MAX_MOVES = 100;

let active = false;
let list = [];
let chosen = null; // index of the chosen object
let drag = null; // { grabbed_m, offset_m } while an object is dragged
let pressed = null; // the newest place of the pointer while it is pressed
let next = null; // the newest change that waits to be sent
let sending = false;
let undos = []; // places before each move: { object, place }
let redos = [];
let gesture = { kind: '', object: null, at: -Infinity };

/** Returns the place of a pointer in the picture, shares of its size; null outside. */
function place(event) {
  const image = $('picture');
  const r = image.getBoundingClientRect();
  const scale = Math.min(r.width / image.naturalWidth, r.height / image.naturalHeight);
  const [w, h] = [image.naturalWidth * scale, image.naturalHeight * scale];
  const at = [(event.clientX - r.left - (r.width - w) / 2) / w, (event.clientY - r.top - (r.height - h) / 2) / h];
  return at.every((x) => x >= 0 && x <= 1) ? at : null;
}

/** Sends the newest change; those between are left out. */
async function flush() {
  if (sending || !next) return;
  const change = next;
  next = null;
  sending = true;
  try {
    const answer = await post('/objects', change);
    flag($('objects-trouble'), '');
    ({ list } = answer.objects);
    show();
  } catch (error) {
    flag($('objects-trouble'), error.message.replace(/^(objects|at|scale|offset_m|turn_deg): /, ''));
  }
  sending = false;
  setTimeout(flush, SEND_MS);
}

function send(change) {
  next = { ...(next?.object === change.object ? next : {}), ...change };
  flush();
}

// ── undo ──────────────────────────────────────────────────────────────────────────────

const placeOf = ({ offset_m, turn_deg, scale }) => ({ offset_m: [...offset_m], turn_deg, scale });

/** Remembers the place of the chosen object before a move of this kind. */
function remember(kind) {
  const now = performance.now();
  const goes = gesture.kind === kind && gesture.object === chosen && now - gesture.at < GESTURE_MS;
  gesture = { kind, object: chosen, at: now };
  if (goes) return;
  undos = [...undos, { object: chosen, place: placeOf(list[chosen]) }].slice(-MAX_MOVES);
  redos = [];
  buttons();
}

/** Returns the object of the newest move in `from` to its place, and remembers the present one in `to`. */
function goBack(from, to) {
  const move = from.pop();
  if (!move || !list[move.object]) return;
  to.push({ object: move.object, place: placeOf(list[move.object]) });
  gesture = { kind: '', object: null, at: -Infinity };
  choose(move.object);
  Object.assign(list[move.object], placeOf(move.place));
  send({ object: move.object, ...move.place });
  show();
}

function buttons() {
  $('object-undo').disabled = !undos.length;
  $('object-redo').disabled = !redos.length;
}

/** Forgets the moves of objects that are no longer there. */
function forget(now) {
  const names = (objects) => JSON.stringify(objects.map(({ name }) => name));
  if (names(now) === names(list)) return;
  [undos, redos] = [[], []];
}

/** Ctrl+Z and Ctrl+Shift+Z or Ctrl+Y while objects are moved; among the settings these belong to them. */
function shortcut(event) {
  const key = event.key.toLowerCase();
  if (!active || !(event.ctrlKey || event.metaKey) || event.target.closest('.adjust, input[type=text], input[type=number]')) return;
  const [back, forth] = [key === 'z' && !event.shiftKey, key === 'y' || (key === 'z' && event.shiftKey)];
  if (!back && !forth) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (back) goBack(undos, redos);
  else goBack(redos, undos);
}

// ── picture ───────────────────────────────────────────────────────────────────────────

async function press(event) {
  if (!active || event.button !== 0) return;
  const at = place(event);
  if (!at) return;
  event.preventDefault();
  $('picture').setPointerCapture(event.pointerId);
  drag = null;
  const press = { at };
  pressed = press;
  try {
    const { object, real_m: real, objects } = await post('/objects', { at });
    flag($('objects-trouble'), '');
    ({ list } = objects);
    choose(object);
    if (object === null || !real) return;
    drag = { grabbed_m: real, offset_m: list[object].offset_m };
    // The pointer has moved while the rig looked for the object.
    if (press.at !== at) { begin(); send({ object, at: press.at, ...drag }); }
    if (pressed !== press) drag = null;
  } catch (error) {
    flag($('objects-trouble'), error.message.replace(/^objects: /, ''));
  }
}

function move(event) {
  const at = pressed ? place(event) : null;
  if (!at) return;
  pressed.at = at;
  if (!drag) return;
  begin();
  send({ object: chosen, at, ...drag });
}

/** Remembers where a drag begins, once. */
function begin() {
  if (drag.begun) return;
  gesture = { kind: '', object: null, at: -Infinity };
  remember('drag');
  Object.defineProperty(drag, 'begun', { value: true });
}

function choose(index) {
  chosen = index;
  show();
}

/** Moves the chosen object by the arrow keys, away from and towards the viewer along the world's axes. */
function nudge(event) {
  const by = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [1, 1], ArrowDown: [1, -1] }[event.key];
  if (!active || chosen === null || !by) return;
  event.preventDefault();
  remember('nudge');
  const offset = [...(next?.offset_m ?? list[chosen].offset_m)];
  offset[by[0]] += by[1] * STEP_M * (event.shiftKey ? 10 : 1);
  list[chosen].offset_m = offset;
  send({ object: chosen, offset_m: offset });
}

// ── beside the picture ────────────────────────────────────────────────────────────────

function show() {
  $('objects-row').hidden = !active;
  refill($('object'), [['', 'None'], ...list.map(({ name }, i) => [String(i), name || `Object ${i + 1}`])], ([value, text]) => new Option(text, value));
  $('object').value = chosen === null ? '' : String(chosen);
  const object = list[chosen];
  buttons();
  for (const id of ['turn', 'size', 'object-reset']) $(id).disabled = !object;
  put($('objects-hint'), object ? 'Drag it on the picture, or move it with the arrow keys while this list is focused (Shift: 10 cm).' : 'Choose an object on the picture or in the list.');
  if (!object) return;
  if (document.activeElement !== $('turn')) $('turn').value = String(Math.round(object.turn_deg));
  if (document.activeElement !== $('size')) $('size').value = String(Math.round(100 * Math.log2(object.scale)) / 100);
  put($('turn-text'), `${Math.round(object.turn_deg)}°`);
  put($('size-text'), `${Math.round(100 * object.scale)} %`);
}

function switchMode() {
  active = !active;
  $('move').ariaPressed = String(active);
  $('picture').classList.toggle('movable', active);
  if (active && $('compare').ariaPressed === 'true') $('compare').click();
  [pressed, drag] = [null, null];
  show();
}

/** Shows the objects where the rig has them. */
export function objects(s) {
  const { requested, shown, list: now } = s.objects;
  const none = !now.length;
  $('move').disabled = none;
  flag($('move-hint'), none && s.frames.composed ? 'There is no virtual object to move; choose a scene under Scene, or with --scene.' : '');
  $('objects-row').toggleAttribute('data-pending', requested !== shown);
  if (sending || next) return;
  forget(now);
  list = now;
  if (chosen !== null && chosen >= list.length) chosen = null;
  if (active) show();
}

/** Connects the picture and the controls. */
export function buildObjects() {
  const image = $('picture');
  $('move').addEventListener('click', switchMode);
  image.addEventListener('pointerdown', press);
  image.addEventListener('pointermove', move);
  for (const end of ['pointerup', 'pointercancel']) image.addEventListener(end, () => { pressed = null; drag = null; });
  image.draggable = false;
  $('object').addEventListener('change', () => choose($('object').value === '' ? null : Number($('object').value)));
  $('object').addEventListener('keydown', nudge);
  $('turn').addEventListener('input', () => { put($('turn-text'), `${$('turn').value}°`); remember('turn'); send({ object: chosen, turn_deg: Number($('turn').value) }); });
  $('size').addEventListener('input', () => { const scale = 2 ** Number($('size').value); put($('size-text'), `${Math.round(100 * scale)} %`); remember('size'); send({ object: chosen, scale }); });
  $('object-reset').addEventListener('click', () => { remember('reset'); send({ object: chosen, offset_m: [0, 0, 0], turn_deg: 0, scale: 1 }); });
  $('object-undo').addEventListener('click', () => goBack(undos, redos));
  $('object-redo').addEventListener('click', () => goBack(redos, undos));
  document.addEventListener('keydown', shortcut, true);
}

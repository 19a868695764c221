// The page of `penumbra photo --browser`: ball and ground are adjusted here, and computed by the program.

import { $, facts, flag, number, pill, put, refill, make } from '/dashboard/text.js';
import { post } from '/dashboard/requests.js';
import { buildTheme } from '/dashboard/theme.js';
import { addHandle, buildDrawing, putHandle, showHandle, unit } from './handles.js';

const POLL_MS = 400;
const SURE = 0.75; // share of an outline that is seen without doubt
const CORNERS = ['First', 'Second', 'Third', 'Fourth'];

let start = null;
let circle = [0, 0, 1]; // x, y, radius
let kind = 'tilt'; // what tells the ground: corners, tilt or tag
let tilt = 30;
let corners = null;
let view = null; // the program's answer to the newest adjustment
let phase = 'waiting';
let composed = 0;
let composedOf = null; // the adjustment of the composite
let asked = null; // the adjustment that is being composed
let handles = null;

function adjustment() {
  const ground = { corners: { corners }, tilt: { tilt }, tag: 'tag' }[kind];
  return { circle, ground };
}

const key = () => JSON.stringify(adjustment());

// ── asking the program ────────────────────────────────────────────────────────────────

let waiting = false;
let stale = false;

/** Asks what the adjustment gives; of those that follow one another quickly, the newest. */
async function ask() {
  stale = true;
  if (waiting) return;
  waiting = true;
  while (stale) {
    stale = false;
    try {
      view = await post('/view', adjustment());
    } catch (error) {
      view = { ball: null, ground: null, trouble: error.message };
    }
    draw();
  }
  waiting = false;
}

function changed() {
  if (phase === 'finished') return;
  if (shown() !== 'place') show('place');
  drawHandles();
  buttons();
  ask();
}

async function compose() {
  asked = key();
  flag($('result-trouble'), '');
  try {
    await post('/compose', adjustment());
    phase = 'composing';
    buttons();
    poll();
  } catch (error) {
    flag($('result-trouble'), error.message);
  }
}

async function finish() {
  try {
    await post('/finish', {});
    phase = 'writing';
    buttons();
    poll();
  } catch (error) {
    flag($('result-trouble'), error.message);
  }
}

/** Follows the program until it waits for the next request, or has ended. */
async function poll() {
  for (;;) {
    let state;
    try {
      state = await (await fetch('/state')).json();
    } catch {
      ended();
      return;
    }
    ({ phase } = state);
    flag($('result-trouble'), state.trouble ?? '');
    if (state.composed !== composed) showComposite(state);
    buttons();
    if (phase === 'finished' || phase === 'waiting') return;
    await new Promise((done) => setTimeout(done, POLL_MS));
  }
}

function ended() {
  document.body.dataset.link = 'lost';
  phase = 'finished';
  flag($('banner'), 'Penumbra has ended. If it did not say that it wrote the picture, start it again.');
  buttons();
}

// ── drawing ───────────────────────────────────────────────────────────────────────────

/** Returns the path of lines whose missing points interrupt them. */
function path(lines) {
  const parts = lines.flatMap((line) => line.map((at, i) => (at ? `${i && line[i - 1] ? 'L' : 'M'}${at[0].toFixed(1)} ${at[1].toFixed(1)}` : '')));
  return parts.join('');
}

function drawHandles() {
  const [x, y, radius] = circle;
  for (const [name, value] of [['cx', x], ['cy', y], ['r', radius]]) $('circle').setAttribute(name, String(value));
  putHandle(handles.centre, [x, y], `${number(x)}, ${number(y)}`);
  putHandle(handles.rim, [x + radius, y], `${number(radius)} pixels`);
  const byCorners = kind === 'corners' && corners;
  handles.corners.forEach((handle, i) => {
    showHandle(handle, Boolean(byCorners));
    if (byCorners) putHandle(handle, corners[i], corners[i].map((c) => number(c)).join(', '));
  });
  $('rectangle').setAttribute('d', byCorners ? `${path([corners])}Z` : '');
  $('tilt').value = String(tilt);
  put($('tilt-text'), `${number(tilt)}°`);
}

function draw() {
  const { ball, ground, trouble } = view;
  $('outline').setAttribute('d', ball ? path([ball.outline]) : '');
  $('grid').setAttribute('d', ground ? path(ground.grid) : '');
  const seen = ball ? `outline seen: ${number(100 * ball.seen, 0)} %` : '';
  put($('seen'), seen);
  $('seen').setAttribute('x', String(circle[0]));
  $('seen').setAttribute('y', String(Math.min(circle[1] + 1.12 * circle[2] + 18 * unit(), start.size[1] - 6 * unit())));
  const sure = ball && ball.is_fitted && ball.seen >= SURE;
  pill($('ball-pill'), seen || '–', !ball ? 'bad' : sure ? 'good' : 'warn');
  flag($('ball-trouble'), !ball ? trouble : ball.is_fitted ? '' : `${start.trouble ?? ''} Too little of the outline is seen here: the circle is used as you place it.`.trim());
  facts($('ball-facts'), ball ? [['Radius, pixels', number(circle[2])], ['Distance', `${number(ball.distance_m, 2)} m`]] : []);
  flag($('ground-trouble'), ball && trouble ? trouble.replace(/^--ground: (the )?/, (_, the) => (the ? 'The ' : '')) : '');
  facts($('ground-facts'), ground ? groundFacts(ground) : []);
  buttons();
}

function groundFacts({ tilt_deg: down, roll_deg: roll, sigma_deg: sigma }) {
  const shown = [['Looks down by', `${number(down)}°`]];
  if (kind !== 'tilt' && down < 80) shown.push(['Rolled by', `${number(roll)}°`]);
  if (sigma !== null) shown.push(['Error, about', `${number(sigma)}°`]);
  return shown;
}

const TONES = { waiting: ['ready', 'good'], composing: ['composing', 'warn'], writing: ['writing', 'warn'], finished: ['done', 'idle'] };

function buttons() {
  const isWaiting = phase === 'waiting';
  const isComposed = isWaiting && composedOf !== null && composedOf === key();
  $('compose').disabled = !isWaiting || !view?.ground || isComposed;
  $('done').disabled = !isComposed;
  pill($('phase'), ...TONES[phase]);
  const hints = {
    waiting: isComposed ? `Done writes ${start?.out} and ends the program.` : composed ? 'Changed since it was composed: compose again.' : 'Compose when outline and grid lie as they should.',
    composing: 'Composing: this takes some seconds.',
    writing: `Writing ${start?.out}.`,
    finished: '',
  };
  put($('result-hint'), hints[phase]);
  if (phase === 'finished' && !document.body.dataset.ended) {
    document.body.dataset.ended = 'yes';
    const failed = $('result-trouble').textContent;
    put($('phase-text'), failed || document.body.dataset.link === 'lost' ? '' : `${start?.out} is written; this page may be closed.`);
  }
}

// ── composite ─────────────────────────────────────────────────────────────────────────

const shown = () => document.querySelector('[name=shown]:checked').value;

function show(which) {
  document.querySelector(`[name=shown][value=${which}]`).checked = true;
  $('place').toggleAttribute('hidden', which !== 'place');
  $('composite').hidden = which !== 'composite';
}

function showComposite(state) {
  ({ composed } = state);
  composedOf = asked;
  $('composite').src = `/composite.png?n=${composed}`;
  refill($('lines'), state.lines, (line) => make('li', '', line));
  $('shown-composite').disabled = false;
  show('composite');
}

// ── start ─────────────────────────────────────────────────────────────────────────────

function chooseGround(which) {
  kind = which;
  corners ??= view?.ground?.square ?? cornersOf(start.size);
  document.querySelector(`[name=ground][value=${which}]`).checked = true;
  $('corners-hint').hidden = which !== 'corners';
  $('tilt-row').hidden = which !== 'tilt';
}

/** A rectangle in the lower half of the picture, where none is better. */
const cornersOf = ([w, h]) => [[0.35, 0.6], [0.65, 0.6], [0.75, 0.85], [0.25, 0.85]].map(([x, y]) => [x * w, y * h]);

function buildHandles() {
  const least = Math.max(4, start.size[0] / 200);
  const most = Math.max(...start.size) / 2;
  handles = {
    centre: addHandle('centre', "Ball's centre", ([x, y]) => { circle = [x, y, circle[2]]; changed(); }),
    rim: addHandle('rim', "Ball's rim", ([x, y]) => {
      circle = [circle[0], circle[1], Math.min(Math.max(Math.hypot(x - circle[0], y - circle[1]), least), most)];
      changed();
    }),
    corners: CORNERS.map((name, i) => addHandle('corner', `${name} corner of the rectangle`, (at) => { corners = corners.with(i, at); changed(); })),
  };
}

async function build() {
  buildTheme();
  start = await (await fetch('/start')).json();
  const { ground } = start.adjustment;
  ({ circle } = start.adjustment);
  put($('name'), start.name);
  put($('picture-facts'), start.size.join(' × '));
  flag($('ball-trouble'), start.trouble ?? '');
  $('by-tag').hidden = !start.has_tag;
  buildHandles();
  buildDrawing(start.size);
  $('photo').setAttribute('width', String(start.shown[0]));
  $('photo').setAttribute('height', String(start.shown[1]));
  if (ground.tilt !== undefined) ({ tilt } = ground);
  if (ground.corners) ({ corners } = ground);
  kind = ground.corners ? 'corners' : ground === 'tag' ? 'tag' : 'tilt';
  $('corners-hint').hidden = kind !== 'corners';
  $('tilt-row').hidden = kind !== 'tilt';
  document.querySelector(`[name=ground][value=${kind}]`).checked = true;
  for (const input of document.querySelectorAll('[name=ground]')) input.addEventListener('change', () => { chooseGround(input.value); changed(); });
  for (const input of document.querySelectorAll('[name=shown]')) input.addEventListener('change', () => show(input.value));
  $('tilt').addEventListener('input', () => { tilt = Number($('tilt').value); changed(); });
  $('compose').addEventListener('click', compose);
  $('done').addEventListener('click', finish);
  drawHandles();
  await ask();
  await poll();
  document.body.dataset.link = 'up';
}

build().catch(ended);

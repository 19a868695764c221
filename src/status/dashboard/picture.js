// The live picture: the stream, and the comparison with the camera's picture of the same frame.

import { isFresh } from './health.js';
import { $, age, flag, put } from './text.js';

let round = 0;
let comparing = false;
let drawing = 0;

/** Opens the stream again; a broken one does not recover by itself. */
export function openStream() {
  round += 1;
  if (comparing) {
    $('picture').removeAttribute('src');
    $('pair').src = `/compare.mjpeg?n=${round}`;
  } else {
    $('pair').removeAttribute('src');
    $('picture').src = `/stream.mjpeg?n=${round}`;
  }
}

/** Closes the stream while the page is hidden, so that the rig need not encode. */
function closeStream() {
  $('picture').removeAttribute('src');
  $('pair').removeAttribute('src');
}

// ── comparison ────────────────────────────────────────────────────────────────────────

/** Draws the camera's picture left of the line and the composited one right of it. Both come in one
 * picture, so they are always of the same frame. */
function draw() {
  drawing = requestAnimationFrame(draw);
  const [pair, canvas] = [$('pair'), $('wipe-canvas')];
  const [width, height] = [pair.naturalWidth, pair.naturalHeight / 2];
  if (!width) return;
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext('2d');
  const at = Math.round((width * $('wipe').value) / 100);
  context.drawImage(pair, 0, 0, width, height, 0, 0, width, height);
  if (at > 0) context.drawImage(pair, 0, height, at, height, 0, 0, at, height);
  if (at > 0 && at < width) {
    const line = Math.max(2, width / 400);
    context.fillStyle = '#000';
    context.fillRect(at - line, 0, 2 * line, height);
    context.fillStyle = '#fff';
    context.fillRect(at - line / 2, 0, line, height);
  }
}

function compare(on) {
  if (on && $('move').ariaPressed === 'true') $('move').click();
  comparing = on;
  $('compare').ariaPressed = String(on);
  $('wipe-row').hidden = !on;
  $('wipe-canvas').hidden = !on;
  $('picture').hidden = on;
  cancelAnimationFrame(drawing);
  if (on) draw();
  if (!document.hidden) openStream();
}

/** Moves the line to where the pointer is. */
function follow(event) {
  if (!comparing || !(event.buttons & 1 || event.type === 'pointerdown')) return;
  const r = $('wipe-canvas').getBoundingClientRect();
  const shown = Math.min(r.width, (r.height * $('wipe-canvas').width) / $('wipe-canvas').height);
  const x = (event.clientX - r.left - (r.width - shown) / 2) / shown;
  $('wipe').value = String(Math.round(100 * Math.max(0, Math.min(1, x))));
  wiped();
}

function wiped() {
  put($('wipe-text'), `${$('wipe').value} %`);
}

// ── state ─────────────────────────────────────────────────────────────────────────────

/** Shows size and state of the picture. */
export function picture(s) {
  const { width, height } = s.resolution;
  if (width && height) $('screen').style.aspectRatio = `${width} / ${height}`;
  put($('picture-facts'), width ? `${width} × ${height}` : '');
  const note = $('picture-note');
  const moving = ['live', 'replaying'].includes(s.session.state);
  const still = moving && Boolean(s.frames.composed) && !isFresh(s);
  note.toggleAttribute('data-over', still);
  if (!s.frames.composed) flag(note, 'Waiting for the first picture …');
  else flag(note, still ? `No new picture for ${age(s.frames.last_age_ms)}` : '');
}

/** Connects the controls of the picture. */
export function buildPicture() {
  $('full').addEventListener('click', () => $('screen').requestFullscreen?.());
  $('compare').addEventListener('click', () => compare(!comparing));
  $('wipe').addEventListener('input', wiped);
  $('wipe-canvas').addEventListener('pointerdown', (event) => { $('wipe-canvas').setPointerCapture(event.pointerId); follow(event); });
  $('wipe-canvas').addEventListener('pointermove', follow);
  document.addEventListener('visibilitychange', () => {
    if (document.hidden) closeStream();
    else openStream();
  });
  window.addEventListener('pagehide', closeStream);
  window.addEventListener('pageshow', (event) => { if (event.persisted) openStream(); });
}

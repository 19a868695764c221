// Handles on the photograph: dragged by mouse, finger or pen, moved by the arrow keys. Places are pixels of the
// photograph, which are the units of the drawing.

import { $ } from '/dashboard/text.js';

const SVG = 'http://www.w3.org/2000/svg';
const DOT_PX = 7; // radius on the screen
const REACH_PX = 20; // the same of what can be grabbed
const LOUPE_SHARE = 1 / 14; // of the photograph's width that the loupe shows

let size = [1, 1];
const handles = [];

export function shape(tag, attributes = {}) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/** Returns how many pixels of the photograph are one of the screen. */
export function unit() {
  const matrix = $('place').getScreenCTM();
  return matrix ? 1 / matrix.a : 1;
}

function place(event) {
  const matrix = $('place').getScreenCTM();
  if (!matrix) return null;
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
  return [x, y];
}

const within = (value, end) => Math.min(Math.max(value, 0), end - 1);

/** Shows what is under the finger, away from it. */
function showLoupe(at) {
  const loupe = $('loupe');
  loupe.toggleAttribute('hidden', !at);
  if (!at) return;
  const half = (size[0] * LOUPE_SHARE) / 2;
  loupe.setAttribute('viewBox', `${at[0] - half} ${at[1] - half} ${2 * half} ${2 * half}`);
  loupe.classList.toggle('right', at[0] < size[0] / 2);
  $('loupe-cross').setAttribute('d', `M${at[0] - half} ${at[1]}h${2 * half}M${at[0]} ${at[1] - half}v${2 * half}`);
}

/** Adds a handle; `moved` is called with the place to which a person moves it. */
export function addHandle(kind, label, moved) {
  const group = shape('g', { class: 'handle', 'data-kind': kind, tabindex: '0', role: 'slider', 'aria-label': label });
  group.append(shape('circle', { class: 'reach' }), shape('circle', { class: 'dot' }));
  const handle = { group, at: [0, 0] };
  let grabbed = null; // from the pointer to the handle
  const move = ([x, y]) => moved([within(x, size[0]), within(y, size[1])]);
  group.addEventListener('pointerdown', (event) => {
    const at = place(event);
    if (event.button !== 0 || !at) return;
    event.preventDefault();
    group.focus();
    group.setPointerCapture(event.pointerId);
    grabbed = [handle.at[0] - at[0], handle.at[1] - at[1]];
    showLoupe(handle.at);
  });
  group.addEventListener('pointermove', (event) => {
    const at = grabbed && place(event);
    if (!at) return;
    move([at[0] + grabbed[0], at[1] + grabbed[1]]);
    showLoupe(handle.at);
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
    group.addEventListener(end, () => { grabbed = null; showLoupe(null); });
  }
  group.addEventListener('keydown', (event) => {
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!by) return;
    event.preventDefault();
    const step = Math.max(0.1, size[0] / 2000) * (event.shiftKey ? 10 : 1);
    move([handle.at[0] + by[0] * step, handle.at[1] + by[1] * step]);
  });
  $('handles').append(group);
  handles.push(handle);
  return handle;
}

/** Puts a handle to a place. */
export function putHandle(handle, at, text) {
  handle.at = at;
  handle.group.setAttribute('transform', `translate(${at[0]} ${at[1]})`);
  handle.group.setAttribute('aria-valuenow', String(Math.round(at[0])));
  handle.group.setAttribute('aria-valuetext', text);
}

export function showHandle(handle, isShown) {
  handle.group.toggleAttribute('hidden', !isShown);
}

/** Keeps handles and text as large on the screen whatever the photograph's size. */
function scale() {
  const px = unit();
  for (const { group } of handles) {
    group.querySelector('.reach').setAttribute('r', String(REACH_PX * px));
    group.querySelector('.dot').setAttribute('r', String(DOT_PX * px));
  }
  $('seen').setAttribute('font-size', String(15 * px));
  $('seen').setAttribute('stroke-width', String(3.5 * px));
}

/** Prepares the drawing for a photograph of `width` × `height` pixels. */
export function buildDrawing([width, height]) {
  size = [width, height];
  // Pixel (0, 0) is the centre of the first.
  $('place').setAttribute('viewBox', `-0.5 -0.5 ${width} ${height}`);
  $('screen').style.aspectRatio = `${width} / ${height}`;
  new ResizeObserver(scale).observe($('place'));
  scale();
}

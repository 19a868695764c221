// Small charts of the values received since the page was opened.

export const LIGHT = '#f2b84b';
export const COOL = '#6fb2ff';
const HISTORY = 240; // two minutes at two values a second
const MIN_SPAN = 40; // values across a chart at least, so that the first ones do not fill it

const histories = new Map();

/** Appends a value to a history; returns the history. */
export function remember(key, value) {
  const history = histories.get(key) ?? [];
  history.push(Number.isFinite(value) ? value : NaN);
  if (history.length > HISTORY) history.shift();
  histories.set(key, history);
  return history;
}

/** Adjusts a canvas to its size on the screen; null while it is hidden. */
function prepare(canvas) {
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

/** Returns the smallest of a few round numbers that is not below `value`. */
function niceAbove(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  const round = [1, 1.5, 2, 3, 4, 5, 6, 8, 10].map((m) => m * power);
  return round.find((r) => r >= value * 0.999) ?? value;
}

function trace(context, history, x, y) {
  context.beginPath();
  let drawing = false;
  history.forEach((value, i) => {
    if (Number.isNaN(value)) { drawing = false; return; }
    if (drawing) context.lineTo(x(i), y(value)); else context.moveTo(x(i), y(value));
    drawing = true;
  });
}

/** Draws a history as a line, with a labelled axis on request. */
export function spark(canvas, history, { colour = LIGHT, axis = false } = {}) {
  const surface = prepare(canvas);
  if (!surface) return;
  const { context, width, height } = surface;
  const top = niceAbove(Math.max(...history.filter(Number.isFinite), 0) * (axis ? 1.05 : 1));
  const [left, inset] = axis ? [30, 8] : [0, 3];
  const span = Math.max(MIN_SPAN, history.length) - 1;
  const x = (i) => left + ((span + 1 - history.length + i) / span) * (width - left - 3);
  const y = (value) => height - inset - (value / top) * (height - 2 * inset);
  if (axis) grid(context, { left, width, top, y });
  context.strokeStyle = colour;
  context.fillStyle = colour;
  context.lineWidth = axis ? 1.8 : 1.4;
  context.lineJoin = 'round';
  trace(context, history, x, y);
  context.stroke();
  if (axis) shade(context, history, x, y);
  dot(context, history, x, y, axis ? 2.8 : 2);
}

/** Fills the area below the line. */
function shade(context, history, x, y) {
  const first = history.findIndex(Number.isFinite);
  if (first < 0 || history.some((value, i) => i > first && Number.isNaN(value))) return;
  context.lineTo(x(history.length - 1), y(0));
  context.lineTo(x(first), y(0));
  context.globalAlpha = 0.13;
  context.fill();
  context.globalAlpha = 1;
}

/** Marks the newest value. */
function dot(context, history, x, y, radius) {
  const last = history.length - 1;
  if (!Number.isFinite(history[last])) return;
  context.beginPath();
  context.arc(x(last), y(history[last]), radius, 0, 7);
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

// Small charts of the values received since the page was opened.

const SPAN_MS = 120_000; // the time across a chart
const LABEL_REM = 0.76;
const MIN_LABEL_PX = 12;
const TIMES = [[0, 'now'], [30_000, '30 s'], [60_000, '1 min'], [90_000, '90 s'], [120_000, '2 min']];

const histories = new Map();

/** Appends a value to a history; returns the history, a list of times and values. */
export function remember(key, value) {
  const history = histories.get(key) ?? [];
  const now = performance.now();
  history.push([now, Number.isFinite(value) ? value : NaN]);
  while (now - history[0][0] > SPAN_MS) history.shift();
  histories.set(key, history);
  return history;
}

/** Returns the size of the labels, pixels: that of small text on the page. */
function labelSize() {
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  return Math.max(LABEL_REM * rem, MIN_LABEL_PX);
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

/** Traces the line; it is broken where values are missing or the page received none for a while. */
function trace(context, history, x, y) {
  context.beginPath();
  let last = null;
  for (const [at, value] of history) {
    const joined = last !== null && at - last < 5000;
    if (Number.isNaN(value)) { last = null; continue; }
    if (joined) context.lineTo(x(at), y(value)); else context.moveTo(x(at), y(value));
    last = at;
  }
}

/** Draws a history as a line over the last two minutes, with labelled axes on request. Colours are
 * those of the canvas's style. */
export function spark(canvas, history, { axis = false } = {}) {
  const surface = prepare(canvas);
  if (!surface) return;
  const { context, width, height } = surface;
  const style = getComputedStyle(canvas);
  const values = history.map(([, value]) => value).filter(Number.isFinite);
  const top = niceAbove(Math.max(...values, 0) * (axis ? 1.05 : 1));
  const size = labelSize();
  const [left, above, below] = axis ? [2.8 * size, 8, 1.7 * size] : [0, 3, 3];
  const now = performance.now();
  const x = (at) => left + (1 - (now - at) / SPAN_MS) * (width - left - 4);
  const y = (value) => height - below - (value / top) * (height - above - below);
  if (axis) grid(context, style, { size, left, width, height, top, x, y, now });
  context.strokeStyle = style.color;
  context.fillStyle = style.color;
  context.lineWidth = axis ? 1.8 : 1.4;
  context.lineJoin = 'round';
  trace(context, history, x, y);
  context.stroke();
  dot(context, history.at(-1), x, y, axis ? 2.8 : 2);
}

/** Marks the newest value. */
function dot(context, newest, x, y, radius) {
  if (!newest || !Number.isFinite(newest[1])) return;
  context.beginPath();
  context.arc(x(newest[0]), y(newest[1]), radius, 0, 7);
  context.fill();
}

function grid(context, style, { size, left, width, height, top, x, y, now }) {
  context.font = `${size}px system-ui, sans-serif`;
  context.lineWidth = 1;
  context.strokeStyle = style.borderTopColor;
  context.fillStyle = style.outlineColor;
  context.textAlign = 'right';
  context.textBaseline = 'middle';
  for (const value of [0, top / 2, top]) {
    context.beginPath();
    context.moveTo(left, Math.round(y(value)) + 0.5);
    context.lineTo(width, Math.round(y(value)) + 0.5);
    context.stroke();
    context.fillText(String(Number(value.toPrecision(2))), left - 6, y(value));
  }
  context.textBaseline = 'alphabetic';
  TIMES.forEach(([ago, label], i) => {
    context.textAlign = i === 0 ? 'right' : i === TIMES.length - 1 ? 'left' : 'center';
    context.fillText(label, Math.max(x(now - ago), left), height - 3);
  });
}

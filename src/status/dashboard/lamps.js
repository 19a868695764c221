// The lamps that the rig has found: over the picture of the environment, and in a plan of the room.

import { $, make } from './text.js';

const NS = 'http://www.w3.org/2000/svg';
const PLAN = 200; // size of the plan

function draw(name, attributes, text) {
  const element = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

const distance = (lamp) => (lamp.distance_m === null ? 'far' : `${lamp.distance_m.toFixed(2)} m`);

/** Returns the place of a direction in the environment's picture, 0 to 1: +X in the middle, +Y left. */
function place([x, y, z]) {
  return [(Math.PI - Math.atan2(y, x)) / (2 * Math.PI), 0.5 - Math.asin(Math.max(-1, Math.min(1, z))) / Math.PI];
}

/** Returns the shared area of two boxes. */
function shared(a, b) {
  const along = (from, size) => Math.max(0, Math.min(a[from] + a[size], b[from] + b[size]) - Math.max(a[from], b[from]));
  return along('x', 'width') * along('y', 'height');
}

/**
 * Places the labels of marks beside them, where they cover neither one another nor a mark: first as close
 * as possible, then farther away with a line to the mark. `labels` are { text, x, y, r } in the picture
 * `svg` of this size.
 */
function spread(svg, labels, [width, height]) {
  const taken = labels.map(({ x, y, r }) => ({ x: x - r, y: y - r, width: 2 * r, height: 2 * r }));
  for (const { text, x, y, r } of labels) {
    const { width: w, height: h } = text.getBBox();
    const places = [1, 2, 3.5, 5].flatMap((far) => {
      const [dx, dy] = [r + 3 + (far - 1) * h * 0.6, (far - 1) * h + r / 2];
      return [[x + dx, y - dy - h / 2], [x + dx, y + dy - h / 2], [x - dx - w, y - dy - h / 2], [x - dx - w, y + dy - h / 2], [x - w / 2, y - r - dy - h], [x - w / 2, y + r + dy]]
        .map(([left, top]) => ({ x: left, y: top, width: w, height: h, far }));
    });
    const isInside = (p) => p.x >= 1 && p.y >= 1 && p.x + w <= width - 1 && p.y + h <= height - 1;
    const cost = (p) => taken.reduce((sum, other) => sum + shared(p, other), 0);
    const cheapest = (all) => all.reduce((a, b) => (cost(b) < cost(a) - 0.5 ? b : a), all[0]);
    let best = cheapest(places.filter(isInside));
    if (!best || cost(best) > 0.5) {
      // Anywhere, the closer the better.
      const free = [];
      for (let top = 1; top + h < height; top += h / 2) for (let left = 1; left + w < width; left += w / 4) free.push({ x: left, y: top, width: w, height: h, far: 9 });
      const away = (p) => Math.hypot(p.x + w / 2 - x, p.y + h / 2 - y);
      best = cheapest(free.sort((a, b) => away(a) - away(b))) ?? places[0];
    }
    text.setAttribute('x', best.x);
    // The baseline: a fifth of the box is below it.
    text.setAttribute('y', best.y + 0.8 * h);
    if (best.far > 1) svg.append(draw('line', { x1: x, y1: y, x2: best.x + (best.x > x ? 0 : w), y2: best.y + h / 2, class: 'leader' }));
    taken.push(best);
  }
}

function over(lamps) {
  const svg = $('lamp-marks');
  const labels = lamps.map((lamp, i) => {
    const [u, v] = place(lamp.direction);
    return { text: draw('text', { x: 0, y: 0 }, `${i + 1} · ${distance(lamp)}`), x: 512 * u, y: 256 * v, r: 9 };
  });
  svg.replaceChildren(...labels.map(({ x, y, r }, i) => draw('circle', lamps[i].unseen ? { cx: x, cy: y, r, class: 'unseen' } : { cx: x, cy: y, r })), ...labels.map(({ text }) => text));
  spread(svg, labels, [512, 256]);
}

/** Draws the room from above, the environment camera in the middle, +X to the right and +Y up. */
function plan(lamps) {
  const near = lamps.filter((lamp) => lamp.distance_m !== null);
  const flat = ({ direction: [x, y], distance_m: d }) => [x * d, y * d];
  const reach = Math.max(1, ...near.map((lamp) => Math.hypot(...flat(lamp)) + lamp.distance_sigma_m)) * 1.15;
  const ring = [0.25, 0.5, 1, 2, 5, 10, 20, 50].filter((r) => r <= reach).pop() ?? 1;
  const [middle, scale] = [PLAN / 2, (PLAN / 2 - 14) / reach];
  const parts = [
    draw('circle', { cx: middle, cy: middle, r: ring * scale, class: 'ring' }),
    draw('text', { x: middle, y: middle + ring * scale - 4, 'text-anchor': 'middle', class: 'ring-text' }, `${ring} m`),
    draw('path', { d: `M${middle - 5} ${middle}h10M${middle} ${middle - 5}v10`, class: 'camera' }),
  ];
  const labels = lamps.map((lamp, i) => {
    const [drawn, label] = inPlan(lamp, i, { middle, scale });
    parts.push(...drawn, label.text);
    return label;
  });
  $('lamp-plan').replaceChildren(...parts);
  spread($('lamp-plan'), labels, [PLAN, PLAN]);
  const words = lamps.map((lamp, i) => `${i + 1}: ${distance(lamp)}`).join(', ');
  $('lamp-plan').setAttribute('aria-label', `Plan of the room with ${lamps.length} lamps: ${words}`);
}

/** Returns what shows a lamp in the plan, and its label, which is placed later. */
function inPlan(lamp, i, { middle, scale }) {
  const [dx, dy] = lamp.direction;
  const length = Math.hypot(dx, dy) || 1;
  const far = lamp.distance_m === null;
  const out = far ? (PLAN / 2 - 14) : lamp.distance_m * length * scale;
  const [ux, uy] = [dx / length, -dy / length];
  const [x, y] = [middle + ux * out, middle + uy * out];
  const parts = [draw('line', { x1: middle, y1: middle, x2: x, y2: y, class: far ? 'far' : 'near' })];
  if (!far) {
    const sigma = lamp.distance_sigma_m * length * scale;
    parts.push(draw('line', { x1: x - ux * sigma, y1: y - uy * sigma, x2: x + ux * sigma, y2: y + uy * sigma, class: 'sigma' }));
    parts.push(draw('circle', { cx: x, cy: y, r: 5 }));
  }
  return [parts, { text: draw('text', { x: 0, y: 0 }, String(i + 1)), x, y, r: 5 }];
}

let shown = '';
// The size of the text depends on that of the page.
addEventListener('resize', () => { shown = ''; });

/** Shows the lamps. */
export function lamps({ lamps: found }) {
  const key = JSON.stringify(found);
  if (key === shown) return;
  shown = key;
  $('lamp-room').hidden = !found.length;
  over(found);
  if (!found.length) return;
  plan(found);
  $('lamp-list').replaceChildren(...found.map((lamp, i) => make('li', '', `${i + 1}: ${lamp.distance_m === null ? 'too far to tell' : `${lamp.distance_m.toFixed(2)} ± ${lamp.distance_sigma_m.toFixed(2)} m`}${lamp.clipped > 0.01 ? `, ${Math.round(100 * lamp.clipped)} % clipped` : ''}${lamp.unseen ? ', not seen by the environment camera, found by shadows' : ''}`)));
}

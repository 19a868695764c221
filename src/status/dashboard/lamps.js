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

function over(lamps) {
  const marks = lamps.flatMap((lamp, i) => {
    const [u, v] = place(lamp.direction);
    const [x, y] = [512 * u, 256 * v];
    const label = draw('text', { x: x > 400 ? x - 12 : x + 12, y: y + (y < 24 ? 16 : -8), 'text-anchor': x > 400 ? 'end' : 'start' }, `${i + 1} · ${distance(lamp)}`);
    return [draw('circle', { cx: x, cy: y, r: 9 }), label];
  });
  $('lamp-marks').replaceChildren(...marks);
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
  lamps.forEach((lamp, i) => parts.push(...inPlan(lamp, i, { middle, scale })));
  $('lamp-plan').replaceChildren(...parts);
  const words = lamps.map((lamp, i) => `${i + 1}: ${distance(lamp)}`).join(', ');
  $('lamp-plan').setAttribute('aria-label', `Plan of the room with ${lamps.length} lamps: ${words}`);
}

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
  parts.push(draw('text', { x: x + 8 * (x < middle ? -1 : 1), y: y + 4, 'text-anchor': x < middle ? 'end' : 'start' }, String(i + 1)));
  return parts;
}

let shown = '';

/** Shows the lamps. */
export function lamps({ lamps: found }) {
  const key = JSON.stringify(found);
  if (key === shown) return;
  shown = key;
  over(found);
  $('lamp-room').hidden = !found.length;
  if (!found.length) return;
  plan(found);
  $('lamp-list').replaceChildren(...found.map((lamp, i) => make('li', '', `${i + 1}: ${lamp.distance_m === null ? 'too far to tell' : `${lamp.distance_m.toFixed(2)} ± ${lamp.distance_sigma_m.toFixed(2)} m`}${lamp.clipped > 0.01 ? `, ${Math.round(100 * lamp.clipped)} % clipped` : ''}`)));
}

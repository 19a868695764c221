// The settings: shows what is in force, sends wishes, and waits until the rig confirms them.

import { stops } from './exposure.js';
import { $, number, percent, put } from './text.js';

const CONFIRM_MS = 4000;
const LIGHTS_HINTS = { adaptive: 'Lamps and sun get their own.', grid: 'Evenly, as in the paper.' };
const SHADOW_HINTS = { ratio: 'Dims the real surface.', subtract: 'Takes light away, as in the paper.' };
const REFLECTIONS_HINTS = { prefiltered: 'By each material’s lobe.', box: 'Box-filtered maps, as in the paper.' };
const LAMP_RESPONSE_HINTS = { intrinsic: 'By what they reflect.', paper: 'By N·L and their relief in the picture.' };
const HIGHLIGHTS_HINTS = { estimated: 'Clipped light, by what surrounds it.', paper: 'Bright regions darken less, as in the paper.' };

const form = $('settings');
const wishes = new Map(); // setting → { value, since } until /status confirms it
let sending = 0;

// Sliders: where the value is written, and how.
const SLIDERS = {
  shadow_strength: ['strength-text', (v) => percent(v, 0)],
  planes_skip_below: ['skip-text', percent],
  planes_recompute_above: ['recompute-text', percent],
  exposure_ev: ['ev-text', stops],
  exposure_min_ev: ['darkest-text', stops],
  exposure_max_ev: ['brightest-text', stops],
  exposure_key: ['key-text', percent],
  exposure_adaptation_s: ['adaptation-text', (v) => `${number(v)} s`],
};

function fieldsOf(name) {
  const found = form.elements[name];
  return found instanceof RadioNodeList ? [...found] : [found];
}

function valueOf(name) {
  const [field] = fieldsOf(name);
  if (field.type === 'checkbox') return field.checked;
  const text = form.elements[name].value;
  return SLIDERS[name] || name === 'light_count' ? Number(text) : text;
}

function show(name, value) {
  const [field] = fieldsOf(name);
  if (field.type === 'checkbox') field.checked = value;
  else form.elements[name].value = String(value);
  if (SLIDERS[name]) {
    const [text, write] = SLIDERS[name];
    put($(text), write(value));
  }
  if (name === 'light_placement') put($('lights-hint'), LIGHTS_HINTS[value] ?? '');
  if (name === 'shadow_mode') put($('shadow-hint'), SHADOW_HINTS[value] ?? '');
  if (name === 'lamp_response') put($('lamp-response-hint'), LAMP_RESPONSE_HINTS[value] ?? '');
  if (name === 'exposure_highlights') put($('highlights-hint'), HIGHLIGHTS_HINTS[value] ?? '');
  if (name === 'reflections') put($('reflections-hint'), REFLECTIONS_HINTS[value] ?? '');
}

const same = (a, b) => (typeof a === 'number' ? Math.abs(a - b) < 1e-4 : a === b);

/** Shows the settings in force, except where a wish is still on its way. */
export function settings(inForce) {
  const now = performance.now();
  for (const [name, value] of Object.entries(inForce)) {
    if (!form.elements[name]) continue;
    const wish = wishes.get(name);
    if (wish && (same(wish.value, value) || now - wish.since > CONFIRM_MS)) wishes.delete(name);
    const waiting = wishes.has(name);
    if (!waiting) show(name, value);
    fieldsOf(name).forEach((f) => f.closest('.row').toggleAttribute('data-pending', waiting));
    if (wish && !waiting && !same(wish.value, value)) say('The rig has not taken this setting.');
  }
  if (!wishes.size && $('adjust-note').textContent === 'Applying …') say('');
}

function say(text) {
  put($('adjust-note'), text);
}

async function send(name) {
  const value = valueOf(name);
  wishes.set(name, { value, since: performance.now() });
  show(name, value);
  say('Applying …');
  const turn = ++sending;
  try {
    const response = await fetch('/settings', {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ [name]: value }),
    });
    if (!response.ok) throw new Error((await response.json()).error);
  } catch (error) {
    wishes.delete(name);
    if (turn === sending) say(error.message);
  }
}

let sliding;
form.addEventListener('input', (event) => {
  const { name } = event.target;
  if (!name) return;
  clearTimeout(sliding);
  if (event.target.type !== 'range') { send(name); return; }
  wishes.set(name, { value: valueOf(name), since: performance.now() });
  show(name, valueOf(name));
  sliding = setTimeout(send, 120, name);
});
form.addEventListener('submit', (event) => event.preventDefault());

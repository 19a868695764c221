// The settings: shows the active values, sends changes, and waits until the rig confirms them.

import { stops } from './exposure.js';
import { $, number, percent, put } from './text.js';

const CONFIRM_MS = 4000;
const LIGHTS_HINTS = { adaptive: 'Compact sources at their true directions.', grid: 'Uniform (Supan 2006).' };
const SHADOW_HINTS = { ratio: 'Scales the real surface.', subtract: 'Subtracts light (Supan 2006).' };
const REFLECTIONS_HINTS = { prefiltered: 'By each material’s lobe.', box: 'Box-filtered maps (DiVerdi 2003).' };
const LAMP_RESPONSE_HINTS = { intrinsic: 'By the reflectance of real surfaces.', paper: 'By N·L and the relief in the picture.' };
const HIGHLIGHTS_HINTS = { estimated: 'Clipped radiance from its surroundings.', paper: 'Bright regions darken less (DiVerdi 2004).' };

const form = $('settings');
const pending = new Map(); // setting → { value, since } until /status confirms it
let sending = 0;

// Sliders: the element that shows the value, and its format.
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

/** Shows the active settings, except those whose change is not confirmed yet. */
export function settings(active) {
  const now = performance.now();
  for (const [name, value] of Object.entries(active)) {
    if (!form.elements[name]) continue;
    const change = pending.get(name);
    if (change && (same(change.value, value) || now - change.since > CONFIRM_MS)) pending.delete(name);
    const waiting = pending.has(name);
    if (!waiting) show(name, value);
    fieldsOf(name).forEach((f) => f.closest('.row').toggleAttribute('data-pending', waiting));
    if (change && !waiting && !same(change.value, value)) note('The rig did not apply this setting.');
  }
  if (!pending.size && $('adjust-note').textContent === 'Applying …') note('');
}

function note(text) {
  put($('adjust-note'), text);
}

async function send(name) {
  const value = valueOf(name);
  pending.set(name, { value, since: performance.now() });
  show(name, value);
  note('Applying …');
  const request = ++sending;
  try {
    const response = await fetch('/settings', {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ [name]: value }),
    });
    if (!response.ok) throw new Error((await response.json()).error);
  } catch (error) {
    pending.delete(name);
    if (request === sending) note(error.message);
  }
}

let sliding;
form.addEventListener('input', (event) => {
  const { name } = event.target;
  if (!name) return;
  clearTimeout(sliding);
  if (event.target.type !== 'range') { send(name); return; }
  pending.set(name, { value: valueOf(name), since: performance.now() });
  show(name, valueOf(name));
  sliding = setTimeout(send, 120, name);
});
form.addEventListener('submit', (event) => event.preventDefault());

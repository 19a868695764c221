// Shadowing planes: a card that is shown while they are the active technique.

import { apply } from './settings.js';
import { $, facts, flag, number, percent, pill, put, whole } from './text.js';

const STATES = { off: ['off', 'idle'], baking: ['baking', 'warn'], ready: ['ready', 'good'], failed: ['failed', 'bad'] };

function progress(p) {
  return p.total ? `light ${whole(p.done)} of ${whole(p.total)}` : 'choosing the planes';
}

function description(p) {
  if (p.state === 'baking') return `Baking, ${progress(p)}; meanwhile the dome lights cast the shadows.`;
  if (p.state === 'failed') return 'The dome lights cast the shadows.';
  if (p.state !== 'ready') return 'Preparing.';
  const megabytes = `${number(p.bake_bytes / 1e6)} MB`;
  if (p.from_cache) return `Read from the cache, ${megabytes}.`;
  return `Baked in ${number(p.bake_seconds)} s, ${megabytes}.`;
}

/** The state beside the choice of the technique. */
function hint(p) {
  if (p.state === 'baking') return p.total ? `Baking: ${percent(p.done / p.total, 0)}. Meanwhile the dome lights cast the shadows.` : 'Choosing the planes …';
  if (p.state === 'failed') return `No planes: ${p.reason}`;
  if (p.state !== 'ready') return '';
  return p.from_cache ? 'Ready, from the cache.' : `Ready, baked in ${number(p.bake_seconds)} s.`;
}

/** Shows the progress of a bake, which can be cancelled. */
function progressOf(p) {
  const baking = p.state === 'baking';
  $('technique-progress').hidden = !baking;
  const bar = $('technique-progress').querySelector('progress');
  if (p.total) bar.value = p.done / p.total;
  else bar.removeAttribute('value');
}

/** Connects the button that cancels a bake: the dome lights go on casting the shadows. */
export function buildPlanes() {
  $('technique-cancel').addEventListener('click', () => apply({ technique: 'image-based-shadowing' }));
}

/** Shows counts and the work saved. */
export function planes(s) {
  const p = s.planes;
  const shown = s.settings.technique === 'shadowing-planes';
  $('planes-card').hidden = !shown;
  flag($('technique-hint'), shown ? hint(p) : '');
  progressOf(shown ? p : {});
  document.querySelectorAll('[data-only=planes]').forEach((row) => { row.hidden = !shown; });
  if (!shown) return;
  pill($('planes-pill'), ...(STATES[p.state] ?? [p.state, 'idle']));
  put($('planes-text'), description(p));
  flag($('planes-trouble'), p.reason);
  facts($('planes-facts'), [
    ['planes', whole(p.planes)], ['visible planes', whole(p.planes_seen)],
    ['lights', whole(p.lights)], ['lights skipped', whole(p.lights_skipped)],
    ['basis images', whole(p.basis_images)], ['black images', whole(p.basis_images_dropped)],
    ['summed now', whole(p.images_summed)], ['work saved', percent(p.work_saved)],
    ['frames without work', whole(p.frames_without_work)],
  ]);
}

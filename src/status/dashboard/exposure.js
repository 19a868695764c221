// In which exposure the picture is shown: rows for what is chosen, and what is in force.

import { $, number, put } from './text.js';

/** Stops with their sign, as photographers write them. */
export function stops(value) {
  if (!Number.isFinite(value)) return '–';
  return `${value > 0 ? '+' : value < 0 ? '−' : ''}${number(Math.abs(value))}\u00a0EV`;
}

/** Shows what is in force, and the settings that matter for it. */
export function exposure(s) {
  const { exposure_mode: mode } = s.settings;
  for (const name of ['manual', 'auto']) {
    document.querySelectorAll(`[data-only=exposure-${name}]`).forEach((row) => { row.hidden = mode !== name; });
  }
  const { ev, wanted_ev: wanted } = s.exposure;
  const going = Math.abs(ev - wanted) > 0.05 ? `, going to ${stops(wanted)}` : '';
  put($('exposure-hint'), ev === 0 && !going ? 'The camera’s own, untouched.' : `${stops(ev)}${going}`);
}

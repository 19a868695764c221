// Exposure: shows the rows of the active mode and the active exposure.

import { $, flag, number } from './text.js';

/** Formats stops with their sign. */
export function stops(value) {
  if (!Number.isFinite(value)) return '–';
  return `${value > 0 ? '+' : value < 0 ? '−' : ''}${number(Math.abs(value))}\u00a0EV`;
}

/** Shows the active exposure and the settings of its mode. */
export function exposure(s) {
  const { exposure_mode: mode } = s.settings;
  for (const name of ['manual', 'auto']) {
    document.querySelectorAll(`[data-only=exposure-${name}]`).forEach((row) => { row.hidden = mode !== name; });
  }
  const { ev, target_ev: target } = s.exposure;
  const change = Math.abs(ev - target) > 0.05 ? `, target ${stops(target)}` : '';
  flag($('exposure_mode-hint'), ev === 0 && !change ? 'Now the camera’s exposure.' : `Now ${stops(ev)}${change}.`);
}

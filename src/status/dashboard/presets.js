// Presets: named sets of settings. Those of the user are kept in this browser.

import { PRESETS } from './controls.js';
import { apply, values } from './settings.js';
import { $, flag, refill } from './text.js';

const KEY = 'penumbra.presets';
const MAX = 50;
const CUSTOM = '';
const CONFIGURED = 'As configured';

function own() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) ?? '[]');
    return Array.isArray(kept) ? kept.filter((p) => Array.isArray(p) && p.length === 2).slice(0, MAX) : [];
  } catch {
    return [];
  }
}

function keep(presets) {
  try {
    localStorage.setItem(KEY, JSON.stringify(presets));
    return '';
  } catch {
    return 'This browser keeps no data for this page, so the preset is lost when it is closed.';
  }
}

let mine = own();
let configured = {};

const all = () => [[CONFIGURED, configured], ...PRESETS, ...mine];

/** Returns the name of the preset whose values are those of the rig. */
function active() {
  const now = values();
  const fits = ([, change]) => Object.keys(change).length && Object.entries(change).every(([name, value]) => now[name] === value);
  // The preset that states most of the values names them best.
  const found = all().filter(fits).sort(([, a], [, b]) => Object.keys(b).length - Object.keys(a).length);
  return found[0]?.[0] ?? CUSTOM;
}

/** Shows which preset the rig's settings are. */
export function presets(s) {
  configured = s.settings_configured;
  const select = $('preset');
  refill(select, [CUSTOM, ...all().map(([name]) => name)], (name) => new Option(name || 'Own values', name));
  if (document.activeElement !== select) select.value = active();
  $('preset-delete').disabled = !mine.some(([name]) => name === select.value);
}

function save(event) {
  event.preventDefault();
  const name = $('preset-name').value.trim();
  if (!name) { flag($('preset-trouble'), 'Give the preset a name.'); return; }
  if ([[CONFIGURED], ...PRESETS].some(([known]) => known === name)) { flag($('preset-trouble'), `“${name}” comes with the program; choose another name.`); return; }
  if (mine.length >= MAX) { flag($('preset-trouble'), `There are ${MAX} presets; delete one first.`); return; }
  mine = [...mine.filter(([known]) => known !== name), [name, values()]];
  flag($('preset-trouble'), keep(mine));
  $('preset-name').value = '';
}

function remove() {
  mine = mine.filter(([name]) => name !== $('preset').value);
  flag($('preset-trouble'), keep(mine));
}

/** Connects the controls of the presets. */
export function buildPresets() {
  $('preset').addEventListener('change', () => {
    const chosen = all().find(([name]) => name === $('preset').value);
    if (chosen) apply(chosen[1]);
  });
  $('preset-form').addEventListener('submit', save);
  $('preset-delete').addEventListener('click', remove);
}

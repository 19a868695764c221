// The theme: that of the system, or light or dark as the viewer chooses.

import { $ } from './text.js';

const KEY = 'penumbra.theme';

function kept() {
  try { return localStorage.getItem(KEY) ?? ''; } catch { return ''; }
}

function use(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  else delete document.documentElement.dataset.theme;
}

/** Applies the chosen theme and connects the switch. */
export function buildTheme() {
  const select = $('theme');
  select.value = kept();
  use(select.value);
  select.addEventListener('change', () => {
    use(select.value);
    try { localStorage.setItem(KEY, select.value); } catch { /* it lasts until the page is closed */ }
  });
}

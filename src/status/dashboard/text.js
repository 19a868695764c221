// Formats numbers and writes into the page.

export const $ = (id) => document.getElementById(id);
export const number = (value, digits = 1) => (Number.isFinite(value) ? value.toFixed(digits) : '–');
export const whole = (value) => (Number.isFinite(value) ? Math.round(value).toLocaleString('en') : '–');
export const percent = (value, digits = 1) => (Number.isFinite(value) ? `${number(100 * value, digits)} %` : '–');

/** Formats milliseconds with three significant digits. */
export function millis(value) {
  if (!Number.isFinite(value)) return '–';
  return `${value.toFixed(value < 10 ? 2 : value < 100 ? 1 : 0)} ms`;
}

export function duration(seconds) {
  const s = Math.floor(seconds);
  const [hours, minutes] = [Math.floor(s / 3600), Math.floor(s / 60) % 60];
  if (hours) return `${hours} h ${minutes} min`;
  return minutes ? `${minutes} min ${s % 60} s` : `${s} s`;
}

export function age(ms) {
  if (!Number.isFinite(ms)) return '–';
  return ms < 1000 ? `${Math.round(ms)} ms` : `${number(ms / 1000)} s`;
}

/** Writes only changed text, so that nothing flickers and screen readers stay quiet. */
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function make(tag, className, text) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  if (text !== undefined) element.textContent = text;
  return element;
}

export function pill(element, text, tone) {
  put(element, text);
  element.dataset.tone = tone;
}

export function flag(element, text) {
  element.hidden = !text;
  put(element, text || '');
}

export function facts(list, pairs) {
  while (list.children.length > pairs.length) list.lastChild.remove();
  pairs.forEach(([name, value], i) => {
    const row = list.children[i] ?? list.appendChild(make('div'));
    if (!row.children.length) row.append(make('dt'), make('dd'));
    put(row.children[0], name);
    put(row.children[1], value);
  });
}

/** Rebuilds a list only when its content has changed. */
export function refill(list, keys, build) {
  const key = JSON.stringify(keys);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...keys.map(build));
}

// Builds the row of a control: label, help button, field, value, hint, progress and reason.

import { make } from './text.js';

function radios({ name, options }, labelId) {
  const group = make('div', 'segments');
  group.setAttribute('role', 'radiogroup');
  group.setAttribute('aria-labelledby', labelId);
  for (const [value, text] of options) {
    const label = make('label');
    const input = make('input');
    Object.assign(input, { type: 'radio', name, value });
    label.append(input, make('span', '', text));
    group.append(label);
  }
  return group;
}

function slider({ name, min, max, step }) {
  const field = make('span', 'slider');
  const input = make('input');
  Object.assign(input, { type: 'range', name, min, max, step });
  const output = make('output', '', '–');
  output.id = `${name}-text`;
  field.append(input, output);
  return field;
}

function toggle({ name }) {
  const input = make('input', 'switch');
  Object.assign(input, { type: 'checkbox', name });
  input.setAttribute('role', 'switch');
  return input;
}

function select({ name, options }) {
  const field = make('select');
  field.name = name;
  options.forEach(([value, text]) => field.append(new Option(text, value)));
  return field;
}

const FIELDS = { choice: radios, slider, switch: toggle, select };

/** Returns a button that shows and hides a help text, for mouse, touch and keyboard, and the text. */
export function help(id, about, text) {
  const button = make('button', 'help', '?');
  button.type = 'button';
  button.ariaLabel = `Help: ${about}`;
  button.ariaExpanded = 'false';
  button.setAttribute('aria-controls', id);
  const words = make('p', 'help-text', text);
  words.id = id;
  words.hidden = true;
  button.addEventListener('click', () => {
    words.hidden = !words.hidden;
    button.ariaExpanded = String(!words.hidden);
  });
  return [button, words];
}

/** Adds the progress bar and the button that cancels what takes time. */
function progress(row, name) {
  const line = make('div', 'row-progress');
  const bar = make('progress');
  bar.max = 1;
  bar.ariaLabel = 'Progress';
  const cancel = make('button', 'button', 'Cancel');
  cancel.type = 'button';
  cancel.id = `${name}-cancel`;
  line.id = `${name}-progress`;
  line.hidden = true;
  line.append(bar, cancel);
  row.append(line);
}

/** Builds the row of a control. */
export function buildRow(control) {
  const { name, label: text, kind } = control;
  const row = make('div', 'row');
  row.dataset.name = name;
  if (control.only) { row.dataset.only = control.only; row.hidden = true; }
  const field = FIELDS[kind](control, `${name}-label`);
  const label = make(kind === 'choice' ? 'span' : 'label', 'label', text);
  label.id = `${name}-label`;
  const input = field.matches('input, select') ? field : field.querySelector('input[type=range]');
  if (input) {
    input.id = `${name}-field`;
    label.htmlFor = input.id;
  }
  const [button, words] = help(`${name}-help`, text, control.help);
  const head = make('div', 'row-head');
  head.append(label, button);
  const hint = make('p', 'hint');
  hint.id = `${name}-hint`;
  hint.hidden = true;
  const trouble = make('p', 'trouble');
  trouble.id = `${name}-trouble`;
  trouble.setAttribute('role', 'alert');
  trouble.hidden = true;
  row.append(head, field, hint, trouble, words);
  if (control.slow) progress(row, name);
  return row;
}

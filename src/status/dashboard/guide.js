// The set-up of a webcam's rig: its steps as the rig reports them in /status.

import { $, make, put, refill } from './text.js';

const SIGNS = { done: '✓', open: '→', failed: '!', waiting: '·' };
const WORDS = { done: 'done', open: 'to do', failed: 'trouble', waiting: 'waits for the steps before' };

function step({ name, title, state, text, todo }) {
  const item = make('li');
  item.dataset.state = state;
  item.dataset.step = name;
  const sign = make('span', 'guide-sign', SIGNS[state]);
  sign.ariaHidden = 'true';
  const head = make('b', '', title);
  head.append(make('span', 'sr', ` – ${WORDS[state]}`));
  item.append(sign, head);
  if (name === 'print') {
    const link = make('a', '', 'sheet.pdf');
    link.href = '/sheet.pdf';
    link.target = '_blank';
    item.append(link);
  }
  if (text) item.append(make('span', 'guide-text muted', text));
  if (todo) item.append(make('span', 'guide-todo', todo));
  return item;
}

/** Shows the steps, and the next thing to do. */
export function guide({ guide: g }) {
  $('guide-card').hidden = !g;
  if (!g) return;
  refill($('guide'), g.steps, step);
  const next = g.steps.find((s) => s.state === 'failed') ?? g.steps.find((s) => s.state === 'open');
  put($('guide-next'), next ? `Next: ${next.title.toLowerCase()}` : 'Everything is set up.');
  $('guide-card').toggleAttribute('data-ready', !next);
}

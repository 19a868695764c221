// The log: what happened to the rig, newest first, by level.

import { $, make, put, refill, whole } from './text.js';

const MAX_LINES = 500;
const RANK = { info: 0, warning: 1, error: 2 };
const TONES = { info: 'idle', warning: 'warn', error: 'bad' };

let entries = [];
let newest = 0;
let loading = false;

function line({ level, unix_ms: at, text, count }) {
  const item = make('li');
  const badge = make('span', 'pill', level);
  badge.dataset.tone = TONES[level] ?? 'idle';
  const time = make('time', 'muted', new Date(at).toLocaleTimeString('en-GB'));
  time.dateTime = new Date(at).toISOString();
  time.title = new Date(at).toLocaleString('en-GB');
  item.append(time, badge, make('span', '', count > 1 ? `${text} (${whole(count)} times)` : text));
  return item;
}

function show() {
  const least = RANK[$('log-level').value] ?? 0;
  const shown = entries.filter(({ level }) => RANK[level] >= least);
  refill($('log'), shown.length ? shown : [null], (entry) => (entry ? line(entry) : make('li', 'muted', 'Nothing.')));
  const count = (level) => entries.filter((entry) => entry.level === level).length;
  const [errors, warnings] = [count('error'), count('warning')];
  put($('log-count'), `${whole(errors)} error${errors === 1 ? '' : 's'}, ${whole(warnings)} warning${warnings === 1 ? '' : 's'}`);
}

/** Fetches the new entries, if there are any. */
export async function log(s) {
  if (s.log.newest < newest) { entries = []; newest = 0; } // the rig was started again
  if (s.log.newest === newest || loading) return;
  loading = true;
  try {
    const response = await fetch(`/log?after=${newest}`, { signal: AbortSignal.timeout(5000) });
    if (response.ok) {
      const { entries: more } = await response.json();
      // A repeated entry comes again, with a new number.
      const repeated = new Set(more.filter(({ count }) => count > 1).map(({ level, text }) => level + text));
      const kept = entries.filter(({ level, text, number }) => !repeated.has(level + text) || newest - number > 16);
      entries = [...more.reverse(), ...kept].slice(0, MAX_LINES);
      newest = Math.max(newest, ...more.map(({ number }) => number));
      show();
    }
  } catch { /* the next status asks again */ }
  loading = false;
}

/** Connects the choice of the level. */
export function buildLog() {
  $('log-level').addEventListener('change', show);
}

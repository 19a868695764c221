// The record button: shows the state of the recording, and starts or stops one.

import { $, duration, flag, pill, put } from './text.js';

const CONFIRM_MS = 4000;
const TONES = { idle: 'idle', recording: 'bad', finished: 'good', failed: 'warn' };
const WORDS = { idle: 'not recording', recording: 'recording', finished: 'recorded', failed: 'ended early' };

const button = $('record');
let state = 'unavailable';
let requestedAt = -Infinity; // when a request was sent that /status has not confirmed yet

/** Formats bytes. */
function size(bytes) {
  const [unit, per] = bytes < 1e9 ? ['MB', 1e6] : ['GB', 1e9];
  return `${(bytes / per).toFixed(1)} ${unit}`;
}

function line(r) {
  if (!r.file) return '';
  const parts = [r.file.split(/[\\/]/).pop(), size(r.bytes), duration(r.seconds)];
  if (r.state === 'recording' && r.seconds_left !== null) parts.push(`${duration(r.seconds_left)} left`);
  if (r.free_bytes !== null) parts.push(`${size(r.free_bytes)} free`);
  if (r.dropped) parts.push(`${r.dropped} dropped: the disk is too slow`);
  return parts.join(' · ');
}

/** Shows the state of the recording. */
export function recording(r) {
  if (r.state !== state) requestedAt = -Infinity;
  state = r.state;
  $('recording-card').hidden = state === 'unavailable';
  pill($('recording-pill'), WORDS[state] ?? state, TONES[state] ?? 'idle');
  put($('recording-facts'), line(r));
  flag($('recording-trouble'), state === 'failed' ? r.description : '');
  put(button, state === 'recording' ? 'Stop recording' : 'Record');
  button.disabled = performance.now() - requestedAt < CONFIRM_MS;
}

async function toggle() {
  requestedAt = performance.now();
  button.disabled = true;
  flag($('recording-trouble'), '');
  try {
    const response = await fetch('/recording', {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ record: state !== 'recording' }),
    });
    if (!response.ok) throw new Error((await response.json()).error);
  } catch (error) {
    requestedAt = -Infinity;
    flag($('recording-trouble'), error.message);
  }
}

button.addEventListener('click', toggle);

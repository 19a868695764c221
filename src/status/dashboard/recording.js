// The record button: shows the state of the recording, and starts or stops one.

import { post } from './requests.js';
import { $, duration, flag, pill, put } from './text.js';

const TONES = { idle: 'idle', recording: 'bad', finished: 'good', failed: 'warn' };
const MAX_LEFT_S = 30 * 86_400; // more time left is no news
const WORDS = { unavailable: 'live only', idle: 'not recording', recording: 'recording', finished: 'recorded', failed: 'ended early' };

const button = $('record');
const composite = $('composite');
let state = 'unavailable';
let asking = false; // while a request is under way
let chosen = false; // whether the viewer has chosen what is recorded
let refusal = ''; // why the last request was refused

/** Formats bytes. */
function size(bytes) {
  const [unit, per] = bytes < 1e9 ? ['MB', 1e6] : ['GB', 1e9];
  return `${(bytes / per).toFixed(1)} ${unit}`;
}

function line(r) {
  if (!r.file) return '';
  const parts = [r.file.split(/[\\/]/).pop(), size(r.bytes), duration(r.seconds)];
  if (r.composites) parts.push(`${r.composites} composited pictures`);
  if (r.state === 'recording' && r.bytes_per_second) parts.push(`${size(r.bytes_per_second * 60)} per minute`);
  if (r.state === 'recording' && r.seconds_left !== null && r.seconds_left < MAX_LEFT_S) parts.push(`${duration(r.seconds_left)} left`);
  if (r.free_bytes !== null) parts.push(`${size(r.free_bytes)} free`);
  if (r.composites_dropped) parts.push(`${r.composites_dropped} composited pictures dropped`);
  if (r.dropped) parts.push(`${r.dropped} dropped: the disk is too slow`);
  return parts.join(' · ');
}

/** Shows the state of the recording. */
export function recording(r) {
  state = r.state;
  const closed = state === 'unavailable';
  flag($('recording-hint'), closed ? 'A recording plays; only a live rig (penumbra run) can be recorded.' : '');
  pill($('recording-pill'), WORDS[state] ?? state, TONES[state] ?? 'idle');
  put($('recording-facts'), line(r));
  flag($('recording-trouble'), state === 'failed' ? r.description : refusal);
  put(button, state === 'recording' ? 'Stop recording' : 'Record');
  button.disabled = asking || closed;
  composite.disabled = closed || state === 'recording';
  if (!chosen || state === 'recording') composite.checked = r.composite;
}

/** Starts or stops a recording; the rig's answer is its state. */
async function toggle() {
  asking = true;
  button.disabled = true;
  refusal = '';
  try {
    const starts = state !== 'recording';
    const answer = await post('/recording', starts ? { record: true, composite: composite.checked } : { record: false });
    asking = false;
    recording(answer);
  } catch (error) {
    asking = false;
    button.disabled = false;
    refusal = error.message;
    flag($('recording-trouble'), refusal);
  }
}

button.addEventListener('click', toggle);
composite.addEventListener('change', () => { chosen = true; });

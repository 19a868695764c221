// Playback of a recording: pause, position, repetition. What is shown is what the rig does.

import { post } from './requests.js';
import { $, flag, put } from './text.js';

const STEPS = 1000;
const SCRUB_MS = 100;

let playing = null; // the newest status of the playback
let timer = 0;
let wanted = null; // the position that is to be sent
let sending = false;

const clock = (seconds) => {
  const s = Math.max(0, seconds);
  return `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, '0')}`;
};

function time(share) {
  put($('playback-time'), `${clock(share * playing.duration_s)} / ${clock(playing.duration_s)}`);
}

/** Shows the playback. */
export function playback(s) {
  playing = s.playback;
  const closed = playing.closed;
  $('playback').hidden = s.session.state === 'live' || playing.duration_s === null;
  if ($('playback').hidden) return;
  const ended = s.session.state === 'ended';
  for (const id of ['play', 'position', 'repeat']) $(id).disabled = Boolean(closed) || ended;
  const reason = closed ? `Playback cannot be controlled: ${closed}.` : '';
  flag($('playback-hint'), ended ? 'The recording has ended; start it again, or with --loop to repeat it.' : reason);
  put($('play'), playing.paused ? 'Play' : 'Pause');
  if (!sending) $('repeat').checked = playing.repeat;
  const jumping = wanted !== null || sending || playing.jumps !== playing.jumps_requested;
  $('playback').toggleAttribute('data-pending', jumping);
  if (!jumping && s.session.progress !== null) {
    $('position').value = String(Math.round(STEPS * s.session.progress));
    time(s.session.progress);
  }
}

/** Sends a change; the rig's answer is its state. */
async function send(change) {
  flag($('playback-trouble'), '');
  sending = true;
  try {
    playing = await post('/playback', change);
    put($('play'), playing.paused ? 'Play' : 'Pause');
  } catch (error) {
    flag($('playback-trouble'), error.message);
  }
  $('repeat').checked = playing.repeat;
  sending = false;
}

async function jump() {
  timer = 0;
  if (sending) { timer = setTimeout(jump, SCRUB_MS); return; }
  const position = wanted;
  wanted = null;
  await send({ position });
}

function scrub() {
  wanted = Number($('position').value) / STEPS;
  time(wanted);
  if (!timer) timer = setTimeout(jump, SCRUB_MS);
}

/** Connects the controls of the playback. */
export function buildPlayback() {
  $('play').addEventListener('click', () => send({ paused: !playing.paused }));
  $('repeat').addEventListener('change', () => send({ repeat: $('repeat').checked }));
  $('position').addEventListener('input', scrub);
}

// Health at a glance: one sign for each thing that the picture needs. A sign is green only if what
// it says is known to be so now; what an old status says is grey.

import { $, age, make, pill, put, refill, whole } from './text.js';

const STILL_MS = 2000; // the age from which a picture counts as old
const RANK = { good: 0, idle: 1, warn: 2, bad: 3 };
const DEVICE_TONES = { absent: 'idle', opening: 'warn', streaming: 'good', silent: 'warn', retrying: 'bad', failed: 'bad', ended: 'idle' };
const DEVICES = { 'scene-camera': 'Scene camera', 'environment-camera': 'Environment camera', tracker: 'Tracker' };
const STATES = { starting: 'getting ready', live: 'live', replaying: 'replaying', paused: 'paused', ended: 'ended', failed: 'failed' };

let encoded = 0;
let encodedAt = performance.now();

/** Returns whether the stream to this page is stuck although the rig composes pictures. */
function isStreamStuck({ stream }, isPictureNew) {
  const now = performance.now();
  if (stream.encoded !== encoded || !isPictureNew || document.hidden) [encoded, encodedAt] = [stream.encoded, now];
  return now - encodedAt > 2 * STILL_MS;
}

/** Whether the newest picture is not old. */
export function isFresh(s) {
  return s.frames.last_age_ms !== null && s.frames.last_age_ms <= STILL_MS;
}

function pictureSign(s) {
  const { state, description } = s.session;
  const { last_age_ms: last } = s.frames;
  if (state === 'failed') return ['bad', description];
  if (['paused', 'ended'].includes(state)) return ['idle', description];
  if (last === null) return ['warn', 'No picture yet.'];
  if (!isFresh(s)) return ['bad', `No new picture for ${age(last)}.`];
  if (isStreamStuck(s, true)) return ['warn', 'The rig composes pictures, but none reaches this page.'];
  return ['good', `${s.frames.per_second.toFixed(1)} pictures per second.`];
}

function poseSign(s) {
  const { source, ambiguous } = s.registration;
  if (!s.frames.composed) return ['idle', 'Not known yet.'];
  if (source === 'none') return ['bad', 'No pose: the camera’s picture is shown without virtual objects.'];
  if (ambiguous) return ['warn', 'Two poses fit the marker; show it at an angle, or more markers.'];
  if (source === 'fixed') return ['good', 'As the configuration states.'];
  return ['good', source === 'hybrid' ? 'Tracker, corrected by markers.' : `By ${source === 'tracker' ? 'the tracker' : source}.`];
}

function lightSign(s) {
  const { stale, age_ms: old, dome_lights: lights } = s.lighting;
  if (stale) return ['bad', `Old light: ${stale}.`];
  if (!lights) return [s.frames.composed ? 'warn' : 'idle', 'Not measured yet.'];
  return ['good', `${whole(lights)} dome lights, ${age(Math.max(0, old))} old.`];
}

function graphicsSign({ adapter }) {
  if (!adapter.name) return ['idle', 'Not known yet.'];
  if (adapter.losses) return ['warn', `The device was lost ${whole(adapter.losses)} times; now ${adapter.name}.`];
  return ['good', adapter.name];
}

function recordingSign({ recording }) {
  if (recording.state === 'recording') return recording.dropped ? ['warn', `${whole(recording.dropped)} messages lost: the disk is too slow.`] : ['good', 'Recording.'];
  return ['bad', recording.description];
}

/** Returns the signs: name, tone, sentence. */
function signs(s) {
  const moving = ['live', 'replaying'].includes(s.session.state);
  // What was true at the last picture need not be true now.
  const now = ([tone, text]) => (tone === 'good' && !(moving && isFresh(s)) ? ['idle', `Last known: ${text}`] : [tone, text]);
  const devices = s.devices.filter((d) => d.state !== 'absent').map((d) => {
    const sign = [DEVICE_TONES[d.state] ?? 'idle', d.reason ?? d.description];
    if (sign[0] === 'good' && d.reason) sign[0] = 'warn';
    return [DEVICES[d.kind] ?? d.kind, ...(s.session.state === 'live' ? sign : now(sign))];
  });
  return [
    ['Picture', ...pictureSign(s)],
    ['Pose', ...now(poseSign(s))],
    ['Light', ...now(lightSign(s))],
    ['Graphics', ...now(graphicsSign(s))],
    ...devices,
    ...(['recording', 'failed'].includes(s.recording.state) ? [['Recording', ...recordingSign(s)]] : []),
  ];
}

function sign([name, tone, text]) {
  const item = make('li');
  const badge = make('span', 'pill', name);
  badge.dataset.tone = tone;
  item.append(badge, make('span', 'sign-text', text));
  return item;
}

function show(list) {
  const worst = list.reduce((a, b) => (RANK[b[1]] > RANK[a[1]] ? b : a), ['', 'good', '']);
  refill($('health'), list, sign);
  return worst;
}

/** Shows the state of the rig. */
export function health(s) {
  const list = signs(s);
  const [name, tone, text] = show(list);
  const moving = ['live', 'replaying'].includes(s.session.state);
  pill($('state-pill'), STATES[s.session.state] ?? s.session.state, moving || tone === 'bad' ? tone : 'idle');
  put($('state-description'), RANK[tone] > 1 ? `${name}: ${text}` : s.session.description);
}

/** Shows that nothing is known, because there is no connection. */
export function healthUnknown() {
  pill($('state-pill'), 'no connection', 'bad');
  put($('state-description'), 'Nothing on this page is up to date.');
  const names = [...$('health').querySelectorAll('.pill')].map((badge) => badge.textContent);
  show(names.map((name) => [name, 'idle', 'Unknown: there is no connection.']));
}

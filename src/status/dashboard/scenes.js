// The scene that is shown: chosen from the folder of scenes, uploaded into it, and saved there.

import { post, upload } from './requests.js';
import { $, flag, put, refill } from './text.js';

const LIST_MS = 10_000;
const MB = 1e6;

let folder = null; // the newest answer to /scenes
let shown; // the scene file of the newest status
let listedAt = -Infinity;
let asking = false; // while a request is under way
let awaited = ''; // the file that is still being loaded
let empty = true; // whether no virtual object is shown

/** Formats bytes. */
const size = (bytes) => (bytes < MB / 10 ? `${Math.max(1, Math.round(bytes / 1e3))} kB` : `${(bytes / MB).toFixed(1)} MB`);

function options() {
  const own = folder.session ? [['session', 'The recording’s or the rig’s own']] : [];
  const files = folder.files.filter((f) => f.kind !== 'texture');
  return [...own, ['none', 'Nothing virtual'], ...files.map((f) => [f.name, `${f.name} (${f.kind}, ${size(f.bytes)})`])];
}

function note() {
  if (folder.closed) return folder.closed;
  const more = folder.left_out ? ` ${folder.left_out} more files are not listed.` : '';
  const limit = folder.max_upload_bytes ? ` Uploads are checked, kept there and never replace a file; at most ${Math.round(folder.max_upload_bytes / MB)} MB each.` : '';
  return `Scene files and models in the folder ${folder.folder}.${more}${limit}`;
}

function show() {
  const closed = !folder || Boolean(folder.closed);
  for (const id of ['scene-show', 'scene-file']) $(id).disabled = closed || asking;
  $('scene-save').disabled = asking || !folder || empty;
  $('scene-upload').disabled = closed || asking || !folder.max_upload_bytes;
  if (!folder) return;
  const select = $('scene-file');
  const chosen = select.value;
  refill(select, options(), ([value, text]) => new Option(text, value));
  const now = shown?.split(/[\\/]/).pop() ?? (folder.session && !empty ? 'session' : 'none');
  select.value = [chosen, now].find((value) => [...select.options].some((o) => o.value === value)) ?? '';
  put($('scene-note'), note());
}

/** Reads the folder again. */
async function list() {
  listedAt = performance.now();
  try {
    const response = await fetch('/scenes', { signal: AbortSignal.timeout(10_000) });
    if (response.ok) folder = await response.json();
  } catch { /* The banner says that the connection is lost. */ }
  show();
}

/** Carries out requests, one at a time, and shows their outcome. */
async function ask(doing, done, request) {
  asking = true;
  flag($('scene-trouble'), '');
  flag($('scene-done'), doing);
  show();
  try {
    const answer = await request();
    flag($('scene-done'), done(answer));
  } catch (error) {
    flag($('scene-done'), '');
    flag($('scene-trouble'), error.message.replace(/^scenes: /, ''));
  }
  asking = false;
  await list();
}

function choose(event) {
  event.preventDefault();
  const file = $('scene-file').value;
  if (!file) return;
  ask(`Loading ${file} …`, (a) => { awaited = a.loading ? a.file : ''; return a.loading ? `${a.file} is still being loaded.` : `${a.file} is shown.`; }, () => post('/scenes', { show: file }));
}

async function take() {
  const files = [...$('scene-content').files];
  $('scene-content').value = '';
  if (!files.length) return;
  let last = '';
  await ask(`Uploading ${files.map((f) => f.name).join(', ')} …`, (kept) => `Uploaded and checked: ${kept.join(', ')}.`, async () => {
    const kept = [];
    // Pictures and models first, because scene files name them.
    const order = (f) => [/\.(png|jpe?g)$/i, /\.(glb|gltf|ply)$/i].findIndex((ending) => ending.test(f.name)) >>> 0;
    for (const file of files.sort((a, b) => order(a) - order(b))) {
      const tooLarge = file.size > folder.max_upload_bytes;
      if (tooLarge) throw new Error(`${file.name}: the file is larger than ${Math.round(folder.max_upload_bytes / MB)} MB ([scene] max_upload_mb)`);
      const entry = await upload(`/scenes/upload?name=${encodeURIComponent(file.name)}`, file);
      kept.push(entry.name);
      if (entry.kind !== 'texture') last = entry.name;
    }
    return kept;
  });
  if (last) $('scene-file').value = last;
}

function save(event) {
  event.preventDefault();
  const name = $('scene-name').value.trim();
  const file = !name || /\.toml$/i.test(name) ? name : `${name}.toml`;
  ask('Saving …', (a) => `Saved. To start with it: --scene ${a.file}`, async () => {
    const answer = await post('/scenes/save', file ? { file } : {});
    $('scene-name').value = '';
    return answer;
  });
}

/** Tells what has become of a scene that took long. */
function settle({ file, reason }) {
  if (!awaited) return;
  const now = file?.split(/[\\/]/).pop();
  const isShown = ['session', 'none'].includes(awaited) ? !now : now === awaited;
  if (!isShown && !reason) return;
  flag($('scene-done'), isShown ? `${awaited} is shown.` : '');
  flag($('scene-trouble'), isShown ? '' : reason);
  awaited = '';
}

/** Shows which scene the rig shows. */
export function scenes(s) {
  const { file } = s.scene;
  settle(s.scene);
  if (empty !== !s.objects.list.length) {
    empty = !empty;
    show();
  }
  const changed = file !== shown;
  shown = file;
  put($('scene-shown'), file ? file.split(/[\\/]/).pop() : '');
  const waits = folder?.closed ? LIST_MS / 8 : LIST_MS;
  if (changed || performance.now() - listedAt > waits) list();
}

/** Connects the controls. */
export function buildScenes() {
  $('scene-form').addEventListener('submit', choose);
  $('scene-save-form').addEventListener('submit', save);
  $('scene-upload').addEventListener('click', () => $('scene-content').click());
  $('scene-content').addEventListener('change', take);
  show();
}

// Requests to the program.

/** Posts JSON and returns the answer; throws its reason if it refuses. */
export const post = (path, body) => send(path, 'application/json', JSON.stringify(body), 10_000);

/** Posts a file and returns the answer; throws its reason if it refuses. */
export const upload = (path, file) => send(path, 'application/octet-stream', file, 120_000);

async function send(path, type, body, limitMs) {
  let response;
  try {
    response = await fetch(path, {
      method: 'POST',
      headers: { 'Content-Type': type },
      body,
      signal: AbortSignal.timeout(limitMs),
    });
  } catch {
    throw new Error('No answer from Penumbra; nothing was changed.');
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(answer.error ?? `Penumbra answers with an error (${response.status}).`);
  return answer;
}

// Requests to the rig.

/** Posts JSON and returns the answer; throws the rig's reason if it refuses. */
export async function post(path, body) {
  let response;
  try {
    response = await fetch(path, {
      method: 'POST',
      headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify(body),
      signal: AbortSignal.timeout(10_000),
    });
  } catch {
    throw new Error('No answer from the rig; nothing was changed.');
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(answer.error ?? `The rig answers with an error (${response.status}).`);
  return answer;
}

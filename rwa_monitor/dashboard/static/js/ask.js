/** Ask the server; what it refuses, or does not answer, is an error in words. */
export async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error("the dashboard's server does not answer");
  }
  const content = await answer.json().catch(() => ({ error: `the answer (status ${answer.status}) cannot be read` }));
  if (!answer.ok) throw Object.assign(new Error(content.error), { status: answer.status });
  return content;
}

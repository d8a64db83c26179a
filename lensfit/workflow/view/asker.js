// Asks for one thing at a time, and only for the newest.

async function sentence(answer) {
  try {
    return (await answer.json()).error || answer.statusText;
  } catch {
    return answer.statusText;
  }
}

export const ENDED = "The process of this page has ended: start lensfit view again, and open the address that it prints";

/** As `fetch`, with a sentence where nobody answers. */
export async function fetched(name, options = {}) {
  try {
    return await fetch(`api/${name}`, options);
  } catch {
    throw new Error(ENDED);
  }
}

/** The answer of the process; null where a newer request took its place. */
export async function ask(name, message) {
  const answer = await fetched(name, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(message),
  });
  if (answer.status === 204) return null;
  if (!answer.ok) throw Object.assign(new Error(await sentence(answer)), { status: answer.status });
  return answer;
}

/** One request in flight; what is wanted meanwhile is asked for when it returns. */
export class Asker {
  constructor(name, answered, failed) {
    Object.assign(this, { name, answered, failed, wanted: null, busy: false });
  }

  want(version, message) {
    this.wanted = { version, message };
    if (!this.busy) this.run();
  }

  forget() {
    this.wanted = null;
  }

  async run() {
    this.busy = true;
    while (this.wanted) {
      const { version, message } = this.wanted;
      this.wanted = null;
      const began = performance.now();
      try {
        const answer = await ask(this.name, { ...message, newest: true });
        if (answer) {
          await this.answered(answer, version, (performance.now() - began) / 1000);
        } else if (!this.wanted) {
          // Another page came before: ask again, in a while.
          await new Promise((done) => setTimeout(done, 300));
          this.wanted ??= { version, message };
        }
      } catch (error) {
        this.failed(error, version);
      }
    }
    this.busy = false;
  }
}

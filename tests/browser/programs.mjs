// SPDX-License-Identifier: Apache-2.0
// Starts and ends the programs under test; whatever is left over is ended when this process is.
import { spawn } from 'node:child_process';
import { createWriteStream } from 'node:fs';
import { createServer } from 'node:net';

const running = new Set();
process.on('exit', () => running.forEach((child) => child.kill('SIGKILL')));
for (const signal of ['SIGINT', 'SIGTERM']) process.on(signal, () => process.exit(130));

/** A TCP port that nothing listens on at this moment. */
export function freePort() {
  return new Promise((resolve, reject) => {
    const probe = createServer();
    probe.once('error', reject);
    probe.listen(0, '127.0.0.1', () => {
      const { port } = probe.address();
      probe.close(() => resolve(port));
    });
  });
}

/** One program that can be started again and again; what it says goes to `log_file`. */
export class Program {
  constructor(name, command, log_file) {
    this.name = name;
    this.command = command;
    this.log = createWriteStream(log_file, { flags: 'a' });
    this.child = null;
  }

  start() {
    const [program, ...args] = this.command;
    const child = spawn(program, args, { stdio: ['ignore', 'pipe', 'pipe'] });
    child.stdout.pipe(this.log, { end: false });
    child.stderr.pipe(this.log, { end: false });
    child.on('error', (error) => this.log.write(`${this.name}: ${error.message}\n`));
    this.child = child;
    running.add(child);
    this.ended = new Promise((resolve) => child.on('close', resolve)).then(() => running.delete(child));
  }

  get alive() {
    return this.child !== null && this.child.exitCode === null && this.child.signalCode === null;
  }

  async end(signal) {
    if (!this.alive) return;
    this.child.kill(signal);
    await this.ended;
  }
}

/** Waits until the server serves its page. */
export async function waitForPage(url, program, patience_ms = 20000) {
  const until = Date.now() + patience_ms;
  for (;;) {
    try {
      if ((await fetch(url)).ok) return;
    } catch {
      // not listening yet
    }
    if (program !== null && !program.alive) throw new Error(`${program.name} ended before it served ${url}`);
    if (Date.now() > until) throw new Error(`nothing serves ${url}`);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}

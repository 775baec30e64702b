// SPDX-License-Identifier: Apache-2.0
// Opens the director's page in a real browser against the real programs and checks what a person would see.
//
//   node run.mjs --build DIR [--shots DIR] [--truth FILE]      builds' mixstage-agent, mixstage-server and page/
//   node run.mjs --url http://localhost:8080/ [...]            a server that runs already: nothing is stopped or killed
//
// --truth is a JSON list of {x, y, z_m, tolerance_m}: depth of the composite at pixels of the picture that stand still
// (z_m null: nothing known there). --server and --agent replace the command lines; {listen}, {lcm}, {build},
// {demo} (deploy/demo) and {scene} (a copy of it: directors save into it) are filled in.
// Prints `ok name` or `FAIL name: why` a line; ends with 1 when a check failed, with 2 when it could not begin.
import { execFileSync } from 'node:child_process';
import { cpSync, mkdirSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { fileURLToPath } from 'node:url';
import { parseArgs } from 'node:util';
import { kAgentChecks, kLastChecks, kLiveChecks, kServerChecks } from './checks.mjs';
import { Director, launch } from './director.mjs';
import { kLoginChecks, kNoWebGlChecks } from './login_checks.mjs';
import { Program, freePort, waitForPage } from './programs.mjs';
import { kScanChecks } from './scan_checks.mjs';
import { kSceneChecks } from './scene_checks.mjs';

const text = { type: 'string' };
const { values: options } = parseArgs({
  options: {
    build: text,
    url: text,
    shots: { ...text, default: join(tmpdir(), 'mixstage_shots') },
    truth: text,
    server: text,
    agent: text,
    only: text,
  },
});

const kServer =
  '{build}/mixstage-server run --rig {demo}/rig.json --scene {scene}/scene.yaml --listen {listen} --lcm {lcm} --page {build}/page';
const kAgent = '{build}/mixstage-agent --source synthetic --lcm {lcm}';
const kScan = '{build}/mixstage-server --log-level warn scan --live --lcm {lcm} --rig {demo}/rig.json';

function command(template, values) {
  return template.split(/\s+/).map((word) => word.replace(/\{(\w+)\}/g, (_, name) => values[name] ?? ''));
}

async function startPrograms(shots) {
  if (options.url !== undefined) return { url: options.url, server: null, agent: null };
  if (options.build === undefined && options.server === undefined)
    throw new Error('give --build DIR or --url URL');
  const listen = `127.0.0.1:${await freePort()}`;
  // A group port of its own keeps this show apart from another on the same machine; ttl 0 keeps it on the machine.
  const lcm = `udpm://239.255.77.${1 + (process.pid % 250)}:${20000 + (process.pid % 20000)}?ttl=0&recv_buf_size=4194304`;
  const demo = fileURLToPath(new URL('../../deploy/demo', import.meta.url));
  const scene = mkdtempSync(join(tmpdir(), 'mixstage_scene_'));
  process.on('exit', () => rmSync(scene, { recursive: true, force: true }));
  cpSync(demo, scene, { recursive: true });
  const values = {
    build: resolve(options.build ?? '.'),
    demo,
    scene,
    listen,
    lcm,
  };
  const server = new Program('server', command(options.server ?? kServer, values), join(shots, 'server.log'));
  const agent = new Program('agent', command(options.agent ?? kAgent, values), join(shots, 'agent.log'));
  server.start();
  const url = `http://${listen}/`;
  await waitForPage(url, server);
  return { url, server, agent, values };
}

let failures = 0;
async function run(checks, context) {
  for (const [name, check] of Object.entries(checks)) {
    if (options.only !== undefined && !name.includes(options.only)) continue;
    try {
      const note = await check(context);
      console.log(`ok ${name}${note === undefined ? '' : ` (${note})`}`);
    } catch (error) {
      failures += 1;
      console.log(`FAIL ${name}: ${String(error.message).split('\n').slice(0, 6).join(' ')}`);
      await context.director.page
        .screenshot({ path: join(context.director.shots, `FAIL_${failures}.png`) })
        .catch(() => {});
    }
  }
}

/** States that need a page of their own. */
async function openElsewise(browser, url, shots) {
  const bare = await Director.open(browser, url, shots, { before: () => delete window.VideoDecoder });
  await run(
    {
      'a browser without WebCodecs is told what to do': async ({ director }) => {
        await director.untilState('UNSUPPORTED');
        if (!/WebCodecs/.test(await director.text('sentence')))
          throw new Error(await director.text('sentence'));
        await director.shoot('no_webcodecs');
      },
    },
    { director: bare },
  );
  await bare.close();
  const insecure = await Director.open(browser, url, shots, {
    before: () => Object.defineProperty(window, 'isSecureContext', { get: () => false }),
  });
  await run(
    {
      'a page over plain http is told what to do': async ({ director }) => {
        await director.untilState('UNSUPPORTED');
        if (!/https|ssh -L/.test(await director.text('advice')))
          throw new Error(await director.text('advice'));
        await director.shoot('insecure');
      },
    },
    { director: insecure },
  );
  await insecure.close();
}

/** A second server hears the same agent, and asks who comes. */
async function openWithLogin(browser, values, shots) {
  const listen = `127.0.0.1:${await freePort()}`;
  const file = join(values.scene, 'tokens.json');
  const token = (name, role) =>
    execFileSync(`${values.build}/mixstage-server`, ['token', 'make', '--file', file, '--name', name, '--role', role])
      .toString()
      .match(/[\w-]{43}/)[0];
  const tokens = { viewer: token('ben', 'viewer'), director: token('anna', 'director') };
  const server = new Program(
    'server',
    [...command(kServer, { ...values, listen }), '--tokens', file],
    join(shots, 'login_server.log'),
  );
  server.start();
  await waitForPage(`http://${listen}/`, server);
  const director = await Director.open(browser, `http://${listen}/`, shots);
  await run(kLoginChecks, { director, tokens });
  await director.close();
  await server.end('SIGTERM');
}

/** A show of its own whose room is scanned: nobody stands in it. */
async function openDuringAScan(values, shots) {
  const show = { ...values, listen: `127.0.0.1:${await freePort()}` };
  const server = new Program('server', command(kServer, show), join(shots, 'scan_show_server.log'));
  const agent = new Program(
    'agent',
    command(kAgent.replace('synthetic', 'synthetic:empty'), show),
    join(shots, 'scan_agent.log'),
  );
  server.start();
  agent.start();
  const url = `http://${show.listen}/`;
  await waitForPage(url, server);
  const scan = (name, ...more) => {
    const out = join(values.scene, name);
    const program = new Program('scan', [...command(kScan, show), '--out', out, ...more], join(shots, 'scan.log'));
    program.start();
    return program;
  };
  const browser = await launch();
  const director = await Director.open(browser, url, shots);
  await run({ ...kScanChecks, ...kLastChecks }, { director, scan, state: {} });
  await browser.close();
  await agent.end('SIGTERM');
  await server.end('SIGTERM');
}

/** Where 3D cannot be drawn. */
async function openWithoutWebGl(url, shots) {
  const browser = await launch(['--disable-webgl', '--disable-webgl2', '--disable-software-rasterizer']);
  const director = await Director.open(browser, url, shots);
  await run(kNoWebGlChecks, { director });
  await browser.close();
}

async function main() {
  const shots = resolve(options.shots);
  mkdirSync(shots, { recursive: true });
  const truth = options.truth === undefined ? null : JSON.parse(readFileSync(options.truth, 'utf8'));
  const { url, server, agent, values } = await startPrograms(shots);
  const browser = await launch();
  await openElsewise(browser, url, shots);
  const director = await Director.open(browser, url, shots);
  const context = { director, server, agent, truth };
  if (agent !== null) {
    await run(
      {
        'before the agent the page says what to start': async () => {
          await director.untilState('NO AGENT');
          if (!/mixstage-agent/.test(await director.text('sentence')))
            throw new Error(await director.text('sentence'));
          await director.shoot('no_agent_yet');
        },
      },
      context,
    );
    agent.start();
    director.opened_ms = Date.now();
  }
  await run(kLiveChecks, context);
  if (server !== null) await run(kSceneChecks, context);
  if (agent !== null) await run(kAgentChecks, context);
  if (server !== null) await run(kServerChecks, context);
  await run(kLastChecks, context);
  await director.close();
  if (options.build !== undefined && agent !== null) await openWithLogin(browser, values, shots);
  await browser.close();
  await openWithoutWebGl(url, shots);
  if (agent !== null) await agent.end('SIGTERM');
  if (server !== null) await server.end('SIGTERM');
  if (options.build !== undefined && agent !== null) await openDuringAScan(values, shots);
  console.log(
    failures === 0 ? `all passed; pictures in ${shots}` : `${failures} failed; pictures in ${shots}`,
  );
  process.exit(failures === 0 ? 0 : 1);
}

main().catch((error) => {
  console.error(`run.mjs: ${error.message}`);
  process.exit(2);
});

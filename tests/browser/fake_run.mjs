// SPDX-License-Identifier: Apache-2.0
// The director's page against the fake show: what needs no rig and no server, and what is hard to bring about with them.
//
//   node fake_run.mjs --page DIR [--shots DIR] [--only TEXT]
//
// Prints `ok name` or `FAIL name: why` a line; ends with 1 when a check failed.
import assert from 'node:assert/strict';
import { mkdirSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { parseArgs } from 'node:util';
import { Director, launch } from './director.mjs';
import { FakeShow, kDirectorToken, kViewerToken } from './fake_server.mjs';
import { lowContrast, misplaced } from './looks.mjs';
import { kSceneChecks, scene } from './scene_checks.mjs';

const { values: options } = parseArgs({
  options: {
    page: { type: 'string' },
    shots: { type: 'string', default: join(tmpdir(), 'mixstage_fake_shots') },
    only: { type: 'string' },
  },
});

const kLooksChecks = {
  'every text has contrast and nothing overlaps, at every size': async ({ director }) => {
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
    for (const [width, height] of [
      [1280, 720],
      [1920, 1080],
      [1024, 768],
      [1180, 820],
      [3840, 2160],
    ]) {
      await director.page.setViewportSize({ width, height });
      await director.page.waitForTimeout(500);
      assert.deepEqual(await director.page.evaluate(misplaced), [], `${width}x${height}`);
      await director.page.screenshot({ path: join(director.shots, `size_${width}x${height}.png`) });
    }
    await director.page.setViewportSize({ width: 1280, height: 720 });
  },
  'details tell of the way, the record and the 3D view': async ({ director }) => {
    await director.page.keyboard.press('i');
    await director.until('the way', () => document.querySelector('[data-testid="way-table"]') !== null);
    assert.match(await director.text('way-table'), /0\.40/);
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
    await director.shoot('details');
    await director.page.keyboard.press('Escape');
  },
  'what another director does is said with his name': async ({ director, show }) => {
    const [object] = (await scene(director)).objects;
    await director.page.waitForTimeout(2000);
    show.edit({ op: 'move', object: object.id, position: [4, 0.2, 0] }, 'anna');
    await director.until('the notice', () =>
      /anna/.test(document.querySelector('[data-testid="scene-notice"]').textContent),
    );
    assert.equal(await director.text('scene-notice'), `anna moved ${object.name}`);
    await director.shoot('anna');
  },
  'a drag sends no more than the server bears': async ({ director, show }) => {
    const sent = show.heard.filter(({ type }) => type === 'edit');
    assert.ok(sent.some(({ live }) => live === true) && sent.some(({ live }) => live === false));
    assert.ok(
      sent.every(({ id }, index) => index === 0 || id > sent[index - 1].id),
      'ids rise',
    );
  },
  'nothing was refused and the console stayed empty': async ({ director }) => {
    assert.equal(await director.value('refused'), '0', await director.value('trouble'));
    assert.deepEqual(director.errors, []);
  },
};

const kLoginChecks = {
  'a page that is asked for a login says so': async ({ director }) => {
    await director.untilState('LOG IN');
    await director.shoot('login');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
  },
  'a wrong token is told to be wrong': async ({ director }) => {
    await director.find('token').fill('x'.repeat(43));
    await director.find('login-button').click();
    await director.until(
      'the sentence',
      () => document.querySelector('[data-testid="login-wrong"]').textContent !== '',
    );
    await director.shoot('wrong_token');
  },
  'a viewer sees everything but handles': async ({ director }) => {
    await director.find('token').fill(kViewerToken);
    await director.page.keyboard.press('Enter');
    await director.until('a scene', () => (document.documentElement.dataset.scene ?? '') !== '');
    await director.until('his name', () =>
      /^ben \(viewer\)$/.test(document.querySelector('[data-testid="user"]').textContent),
    );
    for (const name of ['add', 'save', 'undo', 'hide-1', 'delete-1'])
      assert.equal(await director.find(name).isVisible(), false, name);
    assert.equal(await director.find('light-1').isDisabled(), true);
    await director.find('object-1').click();
    await director.page.keyboard.press('Delete');
    await director.untilMoreFrames('frames', 3);
    await director.shoot('viewer');
    assert.equal((await scene(director)).objects.length, 2);
  },
  'the token lasts as long as the tab': async ({ director }) => {
    await director.page.reload();
    await director.until('a scene', () => (document.documentElement.dataset.scene ?? '') !== '');
  },
  'logging out asks anew, for a director too': async ({ director }) => {
    await director.find('logout').click();
    await director.untilState('LOG IN');
    assert.equal(await director.page.evaluate(() => sessionStorage.length), 0);
    await director.find('token').fill(kDirectorToken);
    await director.page.keyboard.press('Enter');
    await director.until(
      'a handle',
      () => document.querySelector('[data-testid="save"]')?.checkVisibility() === true,
    );
    await director.until(
      'her name',
      () => document.querySelector('[data-testid="user"]').textContent === 'anna',
    );
  },
};

const kNoWebGlChecks = {
  'a browser without WebGL 2 shows everything else': async ({ director }) => {
    await director.until('a first picture', () => Number(document.documentElement.dataset.frames) > 0);
    await director.until('the sentence', () =>
      /WebGL/.test(document.querySelector('[data-testid="pane-room"]').textContent),
    );
    await director.shoot('no_webgl');
  },
};

let failures = 0;
async function run(checks, context) {
  for (const [name, check] of Object.entries(checks)) {
    if (options.only !== undefined && !name.includes(options.only)) continue;
    try {
      await check(context);
      console.log(`ok ${name}`);
    } catch (error) {
      failures += 1;
      console.log(`FAIL ${name}: ${String(error.message).split('\n').slice(0, 6).join(' ')}`);
      const path = join(context.director.shots, `FAIL_${failures}.png`);
      await context.director.page.screenshot({ path }).catch(() => {});
    }
  }
}

async function visit(browser, show, shots, checks) {
  const port = await show.listen(0);
  const director = await Director.open(browser, `http://localhost:${port}/`, shots);
  await run(checks, { director, show });
  await director.close();
  show.close();
}

async function main() {
  if (options.page === undefined) throw new Error('give --page DIR, the built page');
  const shots = resolve(options.shots);
  mkdirSync(shots, { recursive: true });
  const page = resolve(options.page);
  const browser = await launch();
  await visit(browser, new FakeShow({ page }), shots, { ...kSceneChecks, ...kLooksChecks });
  await visit(browser, new FakeShow({ page, login: true }), shots, kLoginChecks);
  await browser.close();
  const bare = await launch(['--disable-webgl', '--disable-webgl2', '--disable-software-rasterizer']);
  await visit(bare, new FakeShow({ page }), shots, kNoWebGlChecks);
  await bare.close();
  console.log(
    failures === 0 ? `all passed; pictures in ${shots}` : `${failures} failed; pictures in ${shots}`,
  );
  process.exit(failures === 0 ? 0 : 1);
}

main().catch((error) => {
  console.error(`fake_run.mjs: ${error.message}`);
  process.exit(2);
});

// SPDX-License-Identifier: Apache-2.0
// What the page must do, one claim a check, in the order in which a show goes. A check throws why it failed.
import assert from 'node:assert/strict';
import { lowContrast, misplaced } from './looks.mjs';

/** A picture that is being shown is younger than this when a second has passed without one. */
const kStill_ms = 700;

async function reading(director) {
  const text = await director.value('probe');
  return text === '' ? null : JSON.parse(text);
}

async function pictureSize(director) {
  const box = await director
    .find('program-canvas')
    .evaluate((canvas) => ({ width: canvas.width, height: canvas.height }));
  return box;
}

async function readAt(director, canvas, x, y, size) {
  await director.pointAway();
  await director.until('no reading', () => document.documentElement.dataset.probe === '');
  await director.pointAt(canvas, x, y, size);
  await director.until('a reading', () => document.documentElement.dataset.probe !== '');
  return reading(director);
}

/** While the show runs: agent and server are up. */
export const kLiveChecks = {
  'a first picture comes': async ({ director }) => {
    await director.until('a first picture', () => Number(document.documentElement.dataset.frames) > 0);
    console.log(`   first picture ${Date.now() - director.opened_ms} ms after opening`);
  },
  'the page says that it is live': async ({ director }) => {
    await director.until('live or learning', () =>
      ['LIVE', 'LEARNING'].includes(document.documentElement.dataset.state),
    );
    if ((await director.value('state')) === 'LEARNING') {
      assert.notEqual(await director.text('sentence'), '');
      await director.shoot('learning');
    }
    await director.untilState('LIVE');
    assert.equal(await director.find('notice').isVisible(), false);
  },
  'program, depth and matte move': async ({ director }) => {
    for (const canvas of ['program-canvas', 'depth-canvas', 'matte-canvas']) {
      const before = await director.pixels(canvas);
      await director.untilMoreFrames('depthFrames', 15);
      await director.untilMoreFrames('frames', 15);
      assert.notEqual(await director.pixels(canvas), before, canvas);
    }
    await director.shoot('live');
  },
  'the numbers in the top bar are numbers': async ({ director }) => {
    await director.until('a latency', () =>
      /^\d+$/.test(document.querySelector('[data-testid="latency"]').textContent),
    );
    for (const name of ['fps', 'bitrate', 'drops'])
      assert.match(await director.text(name), /^[\d.,]+$/, name);
    console.log(
      `   ${await director.text('fps')} fps, ${await director.text('latency')} ms capture to display`,
    );
  },
  'nothing is decoded on the main thread': async ({ director }) => {
    assert.equal(await director.page.evaluate(() => window.mainThreadDecoders), 0);
    // The session's, and the 3D view's.
    assert.equal(director.page.workers().length, 2);
  },
  'nothing is fetched from elsewhere': async ({ director }) => {
    const own = new URL(director.url).origin;
    assert.deepEqual(
      director.requests.filter((url) => !url.startsWith(own) && !url.startsWith('data:')),
      [],
    );
  },
  'the pointer reads metres in program and depth': async ({ director, truth }) => {
    const size = await pictureSize(director);
    const places = truth ?? [{ x: Math.round(size.width / 3), y: Math.round(size.height / 3) }];
    for (const canvas of ['program-canvas', 'depth-canvas']) {
      for (const { x, y, z_m, tolerance_m } of places) {
        const got = await readAt(director, canvas, x, y, size);
        // A small pane cannot be pointed into more exactly than its own pixels.
        const box = await director.find(canvas).boundingBox();
        assert.ok(
          Math.abs(got.x - x) <= size.width / box.width && Math.abs(got.y - y) <= size.height / box.height,
          `pixel ${got.x}, ${got.y}`,
        );
        if (z_m === undefined) continue;
        const why = `${canvas} ${x}, ${y}: read ${got.z_m} m, truth ${z_m} m within ${tolerance_m}`;
        if (z_m === null) assert.equal(got.z_m, null, why);
        else assert.ok(got.z_m !== null && Math.abs(got.z_m - z_m) <= tolerance_m, why);
      }
    }
    assert.notEqual(await director.text('depth-reading'), '');
    await director.shoot('pointer');
    await director.pointAway();
  },
  'space freezes the depth map alone': async ({ director }) => {
    await director.page.keyboard.press('Space');
    await director.until(
      'frozen',
      () => document.querySelector('[data-testid="freeze"]').getAttribute('aria-pressed') === 'true',
    );
    await director.page.waitForTimeout(kStill_ms);
    const before = await director.pixels('depth-canvas');
    await director.untilMoreFrames('depthFrames', 15);
    assert.equal(await director.pixels('depth-canvas'), before);
    await director.shoot('frozen');
    await director.page.keyboard.press('Space');
    await director.until(
      'going on',
      () => document.querySelector('[data-testid="freeze"]').getAttribute('aria-pressed') === 'false',
    );
    await director.untilMoreFrames('depthFrames', 15);
    assert.notEqual(await director.pixels('depth-canvas'), before);
  },
  'labels have a legend': async ({ director }) => {
    await director.page.keyboard.press('l');
    assert.equal(await director.find('legend').isVisible(), true);
    await director.untilMoreFrames('depthFrames', 5);
    await director.shoot('label');
    await director.page.keyboard.press('m');
    assert.equal(await director.find('legend').isVisible(), false);
  },
  'a hidden pane costs no stream': async ({ director }) => {
    await director.find('toggle-depth').click();
    await director.find('toggle-matte').click();
    await director.find('toggle-room').click();
    await director.until('colour alone', () => document.documentElement.dataset.streams === 'color');
    await director.page.waitForTimeout(kStill_ms);
    const depth_frames = await director.number('depthFrames');
    await director.untilMoreFrames('frames', 15);
    assert.equal(await director.number('depthFrames'), depth_frames);
    await director.shoot('program_alone');
    await director.find('toggle-room').click();
    await director.find('toggle-matte').click();
    await director.find('toggle-depth').click();
    await director.untilMoreFrames('depthFrames', 15);
  },
  'the program can be hidden, the last pane cannot': async ({ director }) => {
    for (const key of ['1', '3', '4']) await director.page.keyboard.press(key);
    await director.until('depth alone', () => document.documentElement.dataset.streams === 'depth');
    await director.page.keyboard.press('2');
    assert.equal(await director.find('pane-depth').isVisible(), true);
    await director.untilMoreFrames('depthFrames', 5);
    await director.shoot('depth_alone');
    for (const key of ['1', '3', '4']) await director.page.keyboard.press(key);
    await director.untilMoreFrames('frames', 15);
    await director.untilState('LIVE');
  },
  'details show stages against the budget': async ({ director }) => {
    await director.find('details-button').click();
    await director.until(
      'stages',
      () => document.querySelectorAll('[data-testid="stage-table"] tbody tr').length > 0,
    );
    assert.equal(await director.find('budget-bar').isVisible(), true);
    assert.equal(await director.find('agents-table').isVisible(), true);
    await director.shoot('details');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
    await director.page.keyboard.press('Escape');
    assert.equal(await director.find('details').isVisible(), false);
  },
  'the keyboard reaches everything': async ({ director }) => {
    await director.page.evaluate(() => document.activeElement?.blur());
    const wanted = await director.page.evaluate(
      () =>
        [...document.querySelectorAll('button:enabled, input:enabled, [tabindex="0"]')].filter(
          (part) => part.getClientRects().length > 0,
        ).length,
    );
    const reached = new Set();
    for (let step = 0; step < 2 * wanted; ++step) {
      await director.page.keyboard.press('Tab');
      const where = await director.page.evaluate(() => {
        const at = document.activeElement;
        const outlined = getComputedStyle(at).outlineStyle !== 'none';
        return at === document.body
          ? null
          : { name: at.dataset.testid ?? at.getAttribute('aria-label'), outlined };
      });
      if (where === null) continue;
      assert.ok(where.outlined, `${where.name} does not show its focus`);
      reached.add(where.name);
    }
    assert.equal(reached.size, wanted, [...reached].join(', '));
    await director.page.locator('.pane-program .frame').focus();
    await director.page.keyboard.press('ArrowRight');
    await director.until('a reading', () => document.documentElement.dataset.probe !== '');
    const before = await reading(director);
    await director.page.keyboard.press('ArrowRight');
    await director.until(
      'the next pixel',
      (x) => JSON.parse(document.documentElement.dataset.probe).x === x + 1,
      before.x,
    );
    await director.page.evaluate(() => document.activeElement?.blur());
  },
  'question mark lists the keys': async ({ director }) => {
    await director.page.keyboard.press('?');
    assert.equal(await director.find('help').isVisible(), true);
    await director.shoot('keys');
    await director.page.keyboard.press('Escape');
    assert.equal(await director.find('help').isVisible(), false);
  },
  'text has AA contrast and nothing overlaps': async ({ director }) => {
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
    for (const [width, height] of [
      [1280, 720],
      [1920, 1080],
      [1024, 768],
      [1180, 820],
      [3840, 2160],
    ]) {
      await director.page.setViewportSize({ width, height });
      await director.page.waitForTimeout(300);
      assert.deepEqual(await director.page.evaluate(misplaced), [], `${width}x${height}`);
    }
    await director.page.setViewportSize({ width: 1280, height: 720 });
  },
};

/** What happens when the agent goes: needs an agent that can be ended. */
export const kAgentChecks = {
  'without an agent the page says so': async ({ director, agent }) => {
    await agent.end('SIGTERM');
    await director.untilState('NO AGENT');
    assert.match(await director.text('sentence'), /agent/i);
    await director.until('an age', () => !document.querySelector('[data-testid="program-age"]').hidden);
    await director.shoot('no_agent');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
  },
  'the agent comes back': async ({ director, agent }) => {
    agent.start();
    await director.untilState('LIVE');
    await director.untilMoreFrames('frames', 15);
    assert.equal(await director.find('program-age').isVisible(), false);
  },
};

/** What happens when the server is killed: needs a server that can be. */
export const kServerChecks = {
  'a killed server is waited for': async ({ director, server }) => {
    await server.end('SIGKILL');
    await director.untilState('RECONNECTING');
    assert.match(await director.text('sentence'), /^Reconnecting \(\d+\)$/);
    await director.until('an age', () => !document.querySelector('[data-testid="program-age"]').hidden);
    await director.until('a second attempt', () =>
      /\(([2-9])\)/.test(document.querySelector('[data-testid="sentence"]').textContent),
    );
    await director.shoot('reconnecting');
  },
  'a restarted server is found again': async ({ director, server }) => {
    const started_ms = performance.now();
    server.start();
    await director.until('live or learning', () =>
      ['LIVE', 'LEARNING'].includes(document.documentElement.dataset.state),
    );
    await director.untilMoreFrames('frames', 1);
    const picture_s = (performance.now() - started_ms) / 1000;
    await director.untilMoreFrames('frames', 30);
    await director.untilMoreFrames('depthFrames', 30);
    return `a picture ${picture_s.toFixed(1)} s after the server's start`;
  },
};

/** At the very end. */
export const kLastChecks = {
  'no message was refused': async ({ director }) =>
    assert.equal(await director.value('refused'), '0', await director.value('trouble')),
  'the console stayed empty': async ({ director }) => assert.deepEqual(director.errors, []),
};

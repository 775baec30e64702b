// SPDX-License-Identifier: Apache-2.0
// A live scan beside a running show, as its page tells it.
import assert from 'node:assert/strict';
import { lowContrast } from './looks.mjs';

const untilSentence = (director, pattern, timeout = 60000) =>
  director.until(
    `${pattern}`,
    (source) => {
      const sentence = document.querySelector('[data-testid="scan-sentence"]');
      return sentence !== null && new RegExp(source).test(sentence.textContent);
    },
    pattern.source,
    timeout,
  );

const cells = (director) =>
  director.find('scan-map').evaluate((map) => [...map.children].map((cell) => cell.dataset.cell));

/** `scan`: a function that starts a live scan of the agent's room with further arguments. */
export const kScanChecks = {
  'without a scan nothing is said of one': async ({ director }) => {
    await director.untilState('LIVE');
    assert.equal(await director.find('scan').isVisible(), false);
  },
  'views that are left out are named, and why a scan failed': async ({ director, scan }) => {
    const program = scan('nowhere', '--pan', '140:200', '--tilt', '0:0');
    await untilSentence(director, /1 left out/);
    await director.shoot('scan_left_out');
    await untilSentence(director, /The scan failed: .*at least two/);
    assert.match(await director.text('scan-notes'), /the head does not go there.*the head does not go there/);
    await program.ended;
    await director.shoot('scan_failed');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
  },
  'the map fills up as the head sweeps': async ({ director, scan, state }) => {
    state.killed = scan('killed', '--pan', '-40:40', '--tilt', '-25:25');
    await untilSentence(director, /Sweeping the room: 2 of 6/);
    const map = await cells(director);
    assert.equal(map.length, 6);
    // The next may be recorded by now.
    assert.ok(map.filter((cell) => cell === 'recorded').length >= 2, `${map}`);
    assert.equal(map.filter((cell) => cell === 'the head').length, 1, `${map}`);
    await director.shoot('scan_sweep');
  },
  'a scan that is killed is told to be silent': async ({ director, state }) => {
    await state.killed.end('SIGKILL');
    await untilSentence(director, /silent for \d+ s/, 10000);
    await director.shoot('scan_silent');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
  },
  'the next scan is followed to its result': async ({ director, scan }) => {
    const program = scan('room', '--pan', '-40:40', '--tilt', '-25:25');
    await untilSentence(director, /Sweeping the room/);
    await untilSentence(director, /Computing the room: \w+/, 120000);
    assert.deepEqual(new Set(await cells(director)), new Set(['recorded']));
    await director.shoot('scan_compute');
    await untilSentence(director, /^The room is scanned: [\d.]+ % covered, [\d,]+ triangles/, 240000);
    await program.ended;
    assert.equal(program.child.exitCode, 0);
    await director.shoot('scan_done');
    assert.deepEqual(await director.page.evaluate(lowContrast), []);
    return (await director.text('scan-sentence')).replace('The room is scanned: ', '');
  },
};

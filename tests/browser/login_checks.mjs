// SPDX-License-Identifier: Apache-2.0
// The page of a server that asks for a login, and the page of a browser that cannot draw in 3D.
import assert from 'node:assert/strict';
import { lowContrast } from './looks.mjs';
import { scene } from './scene_checks.mjs';

const untilScene = (director) =>
  director.until('a scene', () => (document.documentElement.dataset.scene ?? '') !== '');

async function logIn(director, token) {
  await director.find('token').fill(token);
  await director.page.keyboard.press('Enter');
}

/** `tokens`: {viewer: ben's, director: anna's}. */
export const kLoginChecks = {
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
  'a viewer sees everything but handles': async ({ director, tokens }) => {
    await logIn(director, tokens.viewer);
    await untilScene(director);
    await director.until('his name', () =>
      /^ben \(viewer\)$/.test(document.querySelector('[data-testid="user"]').textContent),
    );
    const { objects, lights } = await scene(director);
    const handles = ['add', 'save', 'undo', `hide-${objects[0].id}`, `delete-${objects[0].id}`];
    for (const name of handles) assert.equal(await director.find(name).isVisible(), false, name);
    assert.equal(await director.find(`light-${lights[0].id}`).isDisabled(), true);
    await director.find(`object-${objects[0].id}`).click();
    await director.page.keyboard.press('Delete');
    await director.untilMoreFrames('frames', 3);
    await director.shoot('viewer');
    assert.equal((await scene(director)).objects.length, objects.length);
  },
  'the token lasts as long as the tab': async ({ director }) => {
    await director.page.reload();
    await untilScene(director);
  },
  'logging out asks anew, for a director too': async ({ director, tokens }) => {
    await director.find('logout').click();
    await director.untilState('LOG IN');
    assert.equal(await director.page.evaluate(() => sessionStorage.length), 0);
    await logIn(director, tokens.director);
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

export const kNoWebGlChecks = {
  'a browser without WebGL 2 shows everything else': async ({ director }) => {
    await director.until('a first picture', () => Number(document.documentElement.dataset.frames) > 0);
    await director.until('the sentence', () =>
      /WebGL/.test(document.querySelector('[data-testid="pane-room"]').textContent),
    );
    await director.shoot('no_webgl');
  },
};

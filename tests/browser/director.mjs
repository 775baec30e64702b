// SPDX-License-Identifier: Apache-2.0
// The page as a person meets it: opened in Debian's Chromium, looked at, pointed into, photographed.
import { createHash } from 'node:crypto';
import { join } from 'node:path';
import { chromium } from 'playwright-core';

export const kSizes = [
  { width: 1280, height: 720 },
  { width: 1920, height: 1080 },
];
const kFlags = [
  '--no-sandbox',
  '--disable-gpu',
  '--disable-quic',
  '--no-first-run',
  '--disable-background-networking',
  '--disable-component-update',
  '--disable-sync',
];
// What Chromium itself says when a server is away. Everything else on the console is a fault of the page.
const kExpectedNoise = /WebSocket connection to .* failed|net::ERR_CONNECTION_REFUSED/;

/** `flags`: beside the usual ones. */
export function launch(flags = []) {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    headless: true,
    args: [...kFlags, ...flags],
  });
}

export class Director {
  static async open(browser, url, shots, { before } = {}) {
    const context = await browser.newContext({ viewport: kSizes[0] });
    const director = new Director(await context.newPage(), url, shots);
    await director.page.addInitScript(() => {
      // Counts decoders of the main thread; a worker's scope does not see this script.
      window.mainThreadDecoders = 0;
      const Decoder = window.VideoDecoder;
      if (Decoder === undefined) return;
      window.VideoDecoder = class extends Decoder {
        constructor(init) {
          super(init);
          window.mainThreadDecoders += 1;
        }
      };
    });
    if (before !== undefined) await director.page.addInitScript(before);
    director.opened_ms = Date.now();
    await director.page.goto(url);
    return director;
  }

  constructor(page, url, shots) {
    this.page = page;
    this.url = url;
    this.shots = shots;
    this.errors = [];
    this.requests = [];
    page.on('pageerror', (error) => this.errors.push(error.message));
    page.on('request', (request) => this.requests.push(request.url()));
    page.on('console', (message) => {
      if (['error', 'warning'].includes(message.type()) && !kExpectedNoise.test(message.text()))
        this.errors.push(message.text());
    });
  }

  find(testid) {
    return this.page.locator(`[data-testid="${testid}"]`);
  }

  text(testid) {
    return this.find(testid).textContent();
  }

  /** A value that the page publishes on its root element. */
  value(name) {
    return this.page.evaluate((key) => document.documentElement.dataset[key] ?? '', name);
  }

  async number(name) {
    return Number(await this.value(name));
  }

  async until(what, predicate, argument = null, timeout = 30000) {
    try {
      return await this.page.waitForFunction(predicate, argument, { timeout, polling: 50 });
    } catch {
      const { state, link, frames, trouble } = await this.page.evaluate(() => ({
        ...document.documentElement.dataset,
      }));
      throw new Error(
        `waited ${timeout / 1000} s for ${what}; state ${state}, link ${link}, frames ${frames}, trouble "${trouble}"`,
      );
    }
  }

  untilState(word) {
    return this.until(`state ${word}`, (wanted) => document.documentElement.dataset.state === wanted, word);
  }

  async untilMoreFrames(name, more) {
    const least = (await this.number(name)) + more;
    await this.until(
      `${more} more ${name}`,
      ([key, count]) => Number(document.documentElement.dataset[key]) >= count,
      [name, least],
    );
  }

  async pixels(testid) {
    return createHash('sha256')
      .update(await this.find(testid).screenshot())
      .digest('hex');
  }

  /** Mean colour, 0..255 each, of a part of what is on the screen: [left, top, right, bottom], 0..1 of it. */
  async colorOf(testid, [left, top, right, bottom]) {
    const box = await this.find(testid).boundingBox();
    const clip = {
      x: box.x + left * box.width,
      y: box.y + top * box.height,
      width: (right - left) * box.width,
      height: (bottom - top) * box.height,
    };
    const png = (await this.page.screenshot({ clip })).toString('base64');
    return this.page.evaluate(async (text) => {
      const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
      const picture = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
      const context = new OffscreenCanvas(picture.width, picture.height).getContext('2d');
      context.drawImage(picture, 0, 0);
      const { data } = context.getImageData(0, 0, picture.width, picture.height);
      return [0, 1, 2].map((channel) => {
        let sum = 0;
        for (let at = channel; at < data.length; at += 4) sum += data[at];
        return (4 * sum) / data.length;
      });
    }, png);
  }

  /** Puts the mouse on the middle of a pixel of a size.width x size.height picture. */
  async pointAt(testid, x, y, size) {
    const box = await this.find(testid).boundingBox();
    await this.page.mouse.move(
      box.x + (box.width * (x + 0.5)) / size.width,
      box.y + (box.height * (y + 0.5)) / size.height,
    );
  }

  async pointAway() {
    await this.page.mouse.move(2, 2);
  }

  /** One photograph at each size. Needs a moment each: the page lays itself out anew. */
  async shoot(name) {
    for (const size of kSizes) {
      await this.page.setViewportSize(size);
      await this.page.waitForTimeout(400);
      await this.page.screenshot({ path: join(this.shots, `${name}_${size.width}x${size.height}.png`) });
    }
    await this.page.setViewportSize(kSizes[0]);
    await this.page.waitForTimeout(200);
  }

  close() {
    return this.page.context().close();
  }
}

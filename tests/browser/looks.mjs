// SPDX-License-Identifier: Apache-2.0
// What can be said about the looks without an eye: contrast, overlap, things outside the window. Run inside the page.

/** Texts whose contrast to their ground is below WCAG AA, as sentences. Texts over pictures have a ground of their own. */
export function lowContrast() {
  const parse = (color) => (color.match(/[\d.]+/g) ?? []).map(Number);
  const luminance = ([r, g, b]) => {
    const linear = [r, g, b].map((v) =>
      v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4,
    );
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  const groundOf = (element) => {
    for (let at = element; at !== null; at = at.parentElement) {
      const color = parse(getComputedStyle(at).backgroundColor);
      if (color.length === 3 || color[3] > 0.8) return color;
    }
    return [0, 0, 0];
  };
  const faults = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const element = walker.currentNode.parentElement;
    if (walker.currentNode.data.trim() === '' || element.getClientRects().length === 0) continue;
    const style = getComputedStyle(element);
    const [a, b] = [luminance(parse(style.color)), luminance(groundOf(element))].sort((x, y) => y - x);
    const contrast = (a + 0.05) / (b + 0.05);
    const large = parseFloat(style.fontSize) >= 18.66 && Number(style.fontWeight) >= 600;
    if (contrast < (large ? 3 : 4.5))
      faults.push(`"${walker.currentNode.data.trim()}" ${contrast.toFixed(2)}`);
  }
  return faults;
}

/** Parts that lie outside the window or over each other. */
export function misplaced() {
  const faults = [];
  const parts = [...document.querySelectorAll('.bar, .pane, .rail')].filter(
    (part) => part.getClientRects().length > 0,
  );
  const boxes = parts.map((part) => ({ name: part.className, box: part.getBoundingClientRect() }));
  for (const { name, box } of boxes) {
    if (box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight)
      faults.push(`${name} reaches outside the window`);
    if (box.width < 100 || box.height < 40) faults.push(`${name} is ${box.width} x ${box.height}`);
  }
  boxes.forEach((a, index) => {
    for (const b of boxes.slice(index + 1)) {
      const apart =
        a.box.right <= b.box.left ||
        b.box.right <= a.box.left ||
        a.box.bottom <= b.box.top ||
        b.box.bottom <= a.box.top;
      if (!apart) faults.push(`${a.name} overlaps ${b.name}`);
    }
  });
  const bar = document.querySelector('.bar');
  if (bar.scrollWidth > bar.clientWidth) faults.push('the top bar is too narrow for what is in it');
  return faults;
}

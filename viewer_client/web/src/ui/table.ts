// SPDX-License-Identifier: Apache-2.0
import { el } from './dom';

export interface Cell {
  text: string;
  /** Drawn as a warning, and said in words by `title`. */
  over?: boolean;
  title?: string;
}

export interface Column {
  title: string;
  /** Numbers stand right. */
  number?: boolean;
}

/** A plain table; its first column names the row. */
export function table(
  columns: readonly Column[],
  rows: readonly (readonly Cell[])[],
  testid: string,
): HTMLTableElement {
  const side = (column: Column | undefined): string => (column?.number === true ? 'number' : '');
  const head = columns.map((column) =>
    el('th', { class: side(column), text: column.title, attributes: { scope: 'col' } }),
  );
  const body = rows.map((row) => {
    const cells = row.map((cell, index) => {
      const over = cell.over === true ? ' over' : '';
      const options = {
        class: `${side(columns[index])}${over}`,
        text: cell.text,
        attributes: { title: cell.title ?? '' },
      };
      return index === 0
        ? el('th', { ...options, attributes: { ...options.attributes, scope: 'row' } })
        : el('td', options);
    });
    return el('tr', {}, ...cells);
  });
  return el('table', { testid }, el('thead', {}, el('tr', {}, ...head)), el('tbody', {}, ...body));
}

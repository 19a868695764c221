// The columns of wide screens. There are three, and their cards are divided so that none of them stays empty;
// on other screens the cards stand where the document has them.

const WIDE = matchMedia('(min-width: 1800px)');

/** Cards that move on a wide screen, and the column at whose end they stand there. */
const MOVED = [['.timing', '.condition'], ['.balance', '.controls']];

/** Divides the cards between the columns, now and when the width changes. */
export function buildColumns() {
  const moved = MOVED.map(([card, column]) => {
    const element = document.querySelector(card);
    return { element, narrow: element.parentElement, wide: document.querySelector(column) };
  });
  const place = () => moved.forEach(({ element, narrow, wide }) => (WIDE.matches ? wide : narrow).append(element));
  WIDE.addEventListener('change', place);
  place();
}

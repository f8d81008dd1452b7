// A click on a heading sorts by its column, another one the other way round.
const body = document.querySelector("tbody");
const headings = [...document.querySelectorAll("th")];
headings.forEach((heading, column) => {
  heading.querySelector("button").addEventListener("click", () => {
    const up = heading.ariaSort !== "ascending";
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    heading.ariaSort = up ? "ascending" : "descending";
    const key = (row) => row.cells[column].dataset.sort;
    const compare = (a, b) => {
      const [x, y] = [Number(key(a)), Number(key(b))];
      return Number.isNaN(x) || Number.isNaN(y) ? key(a).localeCompare(key(b)) : x - y;
    };
    const rows = [...body.rows].sort((a, b) => (up ? compare(a, b) : compare(b, a)));
    body.append(...rows);
  });
});

// Tables that sort by a click on a heading; missing values stay at the end either way.

export function startTables() {
  for (const button of document.querySelectorAll("th button[data-sort]")) {
    button.addEventListener("click", () => sortBy(button));
  }
}

function sortBy(button) {
  const heading = button.closest("th");
  const descending = heading.getAttribute("aria-sort") === "ascending";
  for (const other of heading.parentElement.children) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", descending ? "descending" : "ascending");
  const compare = comparison(button.dataset.sort === "number", heading.cellIndex, descending);
  const body = heading.closest("table").tBodies[0];
  body.append(...[...body.rows].sort(compare));
}

function comparison(numeric, column, descending) {
  const order = (row) => row.cells[column].dataset.order;
  const sign = descending ? -1 : 1;
  return (a, b) => {
    const [x, y] = [order(a), order(b)];
    if (x === "" || y === "") return (x === "") - (y === "");
    if (numeric) return sign * (Number(x) - Number(y));
    return sign * x.localeCompare(y, "en", { numeric: true });
  };
}

// Headings of a sortable table become buttons that put its rows in order; a row without a value stands last.
{
  const value = (row, column) => {
    const { dataset, textContent } = row.cells[column];
    return "sort" in dataset ? (dataset.sort === "" ? NaN : Number(dataset.sort)) : textContent;
  };
  const order = (a, b) => {
    if (typeof a === "string") return a.localeCompare(b, undefined, { numeric: true });
    return Number.isNaN(a) || Number.isNaN(b) ? 0 : a - b;
  };
  const sort = (table, headings, column) => {
    const down = headings[column].getAttribute("aria-sort") === "ascending";
    headings.forEach((one) => one.removeAttribute("aria-sort"));
    headings[column].setAttribute("aria-sort", down ? "descending" : "ascending");
    const rows = [...table.tBodies[0].rows].map((row) => [value(row, column), row]);
    rows.sort(([a], [b]) => Number.isNaN(a) - Number.isNaN(b) || (down ? order(b, a) : order(a, b)));
    table.tBodies[0].append(...rows.map(([, row]) => row));
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const headings = [...table.tHead.rows[0].cells];
    headings.forEach((heading, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...heading.childNodes);
      button.addEventListener("click", () => sort(table, headings, column));
      heading.append(button);
    });
  }
}

// A table that is wider than its place is shown as a card for each row, in which every value stands behind its heading: nothing is cut off.
{
  const headings = (table) => [...table.tHead.rows[table.tHead.rows.length - 1].cells].map((one) => [...one.childNodes].map(({ textContent }) => textContent).join(" ").trim().replace(/\s+/g, " "));

  // Browsers forget what a table is once its parts are no cells any more.
  const name = (table) => {
    const heads = headings(table);
    table.setAttribute("role", "table");
    for (const part of [table.tHead, ...table.tBodies]) part.setAttribute("role", "rowgroup");
    for (const row of table.rows) {
      row.setAttribute("role", "row");
      [...row.cells].forEach((cell, k) => {
        const inHead = row.parentElement === table.tHead;
        cell.setAttribute("role", inHead && heads[k] ? "columnheader" : !inHead && cell.tagName === "TH" ? "rowheader" : "cell");
        if (!inHead) cell.dataset.label = heads[k] ?? "";
      });
    }
  };

  const fit = (place) => {
    const table = place.querySelector("table");
    if (!table?.tHead || !place.clientWidth) return; // folded
    place.classList.remove("cards");
    if (Math.max(table.scrollWidth, table.getBoundingClientRect().width) <= place.getBoundingClientRect().width) return;
    name(table);
    place.classList.add("cards");
  };

  const seen = new ResizeObserver((entries) => entries.forEach(({ target }) => fit(target.closest(".scroll"))));
  for (const place of document.querySelectorAll(".scroll")) {
    seen.observe(place);
    const body = place.querySelector("tbody");
    if (body) new MutationObserver(() => fit(place)).observe(body, { childList: true });
  }
}

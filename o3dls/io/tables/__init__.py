"""Tables as programs write them: cells of text or of a workbook, and what their headings mean."""

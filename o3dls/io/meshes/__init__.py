"""Surface formats; `registry` chooses a reader by content and a writer by suffix."""

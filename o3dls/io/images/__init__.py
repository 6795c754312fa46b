"""Label volumes and level sets as image volumes; `registry` chooses a reader by content."""

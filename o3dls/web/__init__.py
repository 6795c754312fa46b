"""Pages served to this machine alone: `rules` states whom a server answers, `server` serves its `routes`."""

"""The sections of the report, one file each; `order` lists them, and one without data drops out."""

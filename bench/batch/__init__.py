"""Many short flights in one batch: killed in the middle and gone on with, and beside a shell loop over single ones."""

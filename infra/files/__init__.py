"""Files that survive: appended records come in; files that are whole after a crash or a disk fault come out."""

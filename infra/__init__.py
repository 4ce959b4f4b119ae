"""What knows neither MAVLink nor video: files that survive disks and crashes. Bytes and rows in, whole files out."""

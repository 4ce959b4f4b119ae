"""Reception of one vehicle: packets in, senders, rates, loss, duplicates and rejections out."""

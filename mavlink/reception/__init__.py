"""How one vehicle's packets arrive: packets in, senders, rates, loss, duplicates and rejections out."""

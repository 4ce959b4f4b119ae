"""What one vehicle's packets say of its links: packets in, rates, loss, duplicates and order out."""

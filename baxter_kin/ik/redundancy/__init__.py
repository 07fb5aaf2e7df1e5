"""What a seventh joint leaves free: a pose's self-motion, its pieces, the best point on them."""

"""What does the filter compute with? Functions and matrices with the same bits on every processor (decision 49)."""

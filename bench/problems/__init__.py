"""What benches and tests solve: tops at random, and problems whose answers are known."""

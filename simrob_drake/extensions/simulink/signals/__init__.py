"""What signals do to joints: servos, references, monitors."""

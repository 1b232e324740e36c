"""How near a picture comes to the ground truth: metrics, and the losses that training minimises."""

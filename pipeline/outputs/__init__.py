"""What is made from pictures: animations, galleries and contact sheets."""

"""What is made from pictures (animations, galleries, contact sheets), and checks of outputs that exist already."""

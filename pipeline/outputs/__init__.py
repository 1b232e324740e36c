"""What is made of pictures: animations, galleries and contact sheets; and which outputs exist already."""

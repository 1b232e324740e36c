"""Many scan files to many pictures: names of the outputs, existing ones, a common view, file after file."""

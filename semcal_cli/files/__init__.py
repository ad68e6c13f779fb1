"""What is read and written: documents, images and point clouds."""

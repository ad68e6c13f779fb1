"""Reading and writing of documents, images and point clouds."""

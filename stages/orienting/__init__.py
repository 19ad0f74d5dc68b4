"""How shapes stand: by their keypoints where they have some, else by how alike they are to those that have."""

"""How predicted keypoints compare with annotated ones."""

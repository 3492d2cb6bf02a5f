"""What a simulator offers: scenes, facts, layouts, cameras and the LiDAR; no task."""

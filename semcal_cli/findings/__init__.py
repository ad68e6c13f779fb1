"""What a check says: findings, limits, and the entry that explains a finding."""

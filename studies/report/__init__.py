"""The kit that every study reports with: findings, figures over runs, markdown, drawings and worker processes."""

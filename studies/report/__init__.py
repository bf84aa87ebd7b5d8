"""The common reporting of studies: findings, figures over runs, markdown, drawings, workers."""

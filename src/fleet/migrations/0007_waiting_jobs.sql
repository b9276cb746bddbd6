-- A job that no station has taken can be put into the queue of another line, too: nothing was marked. A list goes to one station only,
-- because each station counts its own serial numbers.

DROP FUNCTION isomark.take_over(text, text, boolean);

-- Puts jobs into a queue: the job with this number at the start, or all that a station with this name has taken. Gives for each what
-- became of it: 'moved'; 'waits' in its queue if no line is given for a job that nobody has taken; 'alive' for a job that stays with a
-- station that is alive, unless it is forced; 'list' for a list that a group of stations must not take. Who moves a job that was taken
-- knows that it may have been marked.
CREATE FUNCTION isomark.take_over(its_target text, its_line text, is_forced boolean)
RETURNS TABLE (id text, name text, station text, line text, outcome text, is_served boolean)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
#variable_conflict use_column
DECLARE
    job isomark.job;
    is_alive boolean;
    what text;
    next_line text;
BEGIN
    FOR job IN
        SELECT * FROM isomark.job AS j WHERE j.state <> 'ended'
        AND (j.station = its_target OR (its_target ~ '^[0-9a-f]{8,64}$' AND starts_with(j.id, its_target)))
        ORDER BY j.number FOR UPDATE
    LOOP
        next_line := coalesce(its_line, job.line);
        SELECT s.runs AND s.beat > now() - interval '45 s' INTO is_alive FROM isomark.station AS s WHERE s.name = job.station;
        what := CASE
            WHEN job.state = 'waiting' AND next_line = job.line THEN 'waits'
            WHEN coalesce(is_alive, false) AND NOT is_forced THEN 'alive'
            WHEN EXISTS (SELECT FROM isomark.line AS l WHERE l.line = next_line AND l.station <> next_line)
                AND EXISTS (SELECT FROM isomark.job_inputs AS i WHERE i.job = job.id AND i.list IS NOT NULL) THEN 'list'
            ELSE 'moved'
        END;
        IF what = 'moved' THEN
            UPDATE isomark.job AS j SET state = 'waiting', station = NULL, taken = NULL, line = next_line WHERE j.id = job.id;
            PERFORM pg_notify('isomark', 'job ' || next_line);
        END IF;
        RETURN QUERY SELECT job.id, job.name, job.station, CASE WHEN what = 'moved' THEN next_line ELSE job.line END, what,
            EXISTS (SELECT FROM isomark.line AS l WHERE l.line = next_line);
    END LOOP;
END $$;

-- Removes a station that is gone, so that its name is free for another login. One that is alive, or that has taken jobs which have
-- not ended, stays. Gives whether it is alive, and the number of these jobs.
CREATE FUNCTION isomark.forget_station(its_name text) RETURNS TABLE (is_alive boolean, jobs bigint)
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog, pg_temp AS $$
DECLARE
    known isomark.station;
BEGIN
    SELECT * INTO known FROM isomark.station AS s WHERE s.name = its_name FOR UPDATE;
    is_alive := coalesce(known.runs AND known.beat > now() - interval '45 s', false);
    SELECT count(*) INTO jobs FROM isomark.job AS j WHERE j.station = its_name AND j.state = 'taken';
    IF NOT is_alive AND jobs = 0 THEN
        DELETE FROM isomark.station AS s WHERE s.name = its_name;
    END IF;
    RETURN NEXT;
END $$;

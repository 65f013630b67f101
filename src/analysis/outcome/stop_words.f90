!> Lines of the summary about events and their stops.
module stop_words
  use transient, only: transient_march
  use contact_mass, only: mass_at, drives_against
  use evaluation_results, only: evaluation
  use kinds, only: wp
  use results, only: most_events
  use scene_run, only: run_state
  use step_counts, only: actual_step
  use stop_advice, only: cannot_follow
  use summary_text, only: summary_record
  use text, only: either, es_text, to_text
  implicit none (type, external)
  private
  public :: stop_lines

contains

  !> Events by kind, then a line for each stop.
  subroutine stop_lines(run, march, text)
    type(run_state), intent(in) :: run
    type(transient_march), intent(in) :: march
    type(summary_record), intent(inout) :: text
    integer :: i
    if (.not. allocated(run%sys%tally)) return
    associate (all => run%sys%tally(:run%sys%m%s%stops))
      if (size(all) == 0) return
      call text%open('events', '{')
      call text%line('  events: {count #}: touched {touched #}, opened {opened #}, let go before they opened {let_go #}, '// &
        'pressed again {pressed #}', [real(wp) :: sum(all%count()), sum([(all(i)%touched, i=1, size(all))]), sum(all%opened), &
                              sum(all%let_go), sum(all%pressed)])
      call text%close()
      associate (r => run%d%transient, h => run%sys%shortest_limit)
        if (.not. r%adaptive) then
          if (h < actual_step(r%output_step, r%step)) call text%line('  steps were divided while stops touched, the shortest '// &
            'contact allows {step_in_contact 3} s', [h])
        end if
      end associate
      if (march%files%events > most_events) call text%line('  events.txt has the first '//to_text(most_events)//' of them')
      call text%open('stops', '[')
      do i = 1, size(all)
        call one_stop(run, i, text)
      end do
      call text%close()
    end associate
  end subroutine stop_lines

  !> One stop: its contacts, their forces, the energy lost.
  subroutine one_stop(run, i, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: i                   !! its number among those that switch
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: unit
    real(wp) :: lost                           ! [J]
    associate (m => run%sys%m, x => run%sys%tally(i), f => run%sys%m%s%forces(run%sys%m%s%switching(i))%item)
      unit = either('Nm', 'N', f%angular)
      lost = run%y(2*m%s%nq + m%s%nz + m%s%nzd + 2 + i)
      call text%open('', '{')
      call text%say('  stop "{name='//trim(f%name)//'}": contacts {touched #}', [real(wp) :: sum(x%touched)])
      if (x%count() == 0 .and. .not. x%depth > 0.0_wp) then
        call text%line('')
        call text%close()
        return
      end if
      call text%say(' ({touched_upper #} at the upper limit)', [real(wp) :: x%touched(1)])
      if (x%count() > 0) call text%say(', events from {first 6} s to {last 6} s', [x%first, x%last])
      if (f%row > 0) then
        call text%say('; largest force {largest_force 4} '//unit//', impulse {largest_impulse 4} '//unit//'s; lost {lost 4} J', &
                      [x%force, x%impulse, lost])
      else
        call text%say('; largest force {largest_force 4} '//unit//', penetration {largest_penetration 4} '// &
                      either('rad', 'm', f%angular)//'; lost {lost 4} J', [x%force, x%depth, lost])
      end if
      if (x%fewest < huge(1)) call text%say('; shortest contact {shortest_contact 3} s, steps in it '// &
        '{steps_of_shortest_contact #}', [real(wp) :: x%briefest, x%fewest])
      call text%line('')
      call text%close()
      call warn_of_contacts(run, i, text)
    end associate
  end subroutine one_stop

  !> Warns of contacts that a body's mesh or modes cannot follow, and of a stop that a drive presses.
  subroutine warn_of_contacts(run, i, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: i                   !! its number among those that switch
    type(summary_record), intent(inout) :: text
    type(evaluation) :: work
    character(:), allocatable :: limit
    integer :: side
    associate (m => run%sys%m, x => run%sys%tally(i), f => run%sys%m%s%forces(run%sys%m%s%switching(i))%item)
      do side = 1, 2
        limit = cannot_follow(m, merge(f%ia, f%ib, side == 1), x%briefest)
        if (len(limit) == 0) cycle
        call text%warn('a contact with stop "'//trim(f%name)//'" lasts'//es_text(x%briefest, 2)//' s, '//limit//': its '// &
                  'force is not converged (more elements or modes, or a softer stop)')
      end do
      if (x%mass < huge(1.0_wp) .or. .not. x%depth > 0.0_wp) return
      work = run%sys%ev
      if (mass_at(m, work, m%s%switching(i)) < huge(1.0_wp)) return
      if (len(drives_against(m, work)) == 0) return
      call text%warn('stop "'//trim(f%name)//'" is pressed by drive'//drives_against(m, work)//', which moves on against '// &
                'any force: up to '//to_text(x%force)//either(' Nm', ' N', f%angular))
    end associate
  end subroutine warn_of_contacts
end module stop_words

!> Lines of the summary about events and their stops.
module stop_words
  use contact_mass, only: mass_at, drives_against
  use evaluation_results, only: evaluation
  use kinds, only: wp
  use readable_text, only: json_text
  use results, only: most_events
  use scene_run, only: run_state, warn
  use step_bounds, only: step_of
  use step_counts, only: actual_step
  use stop_advice, only: cannot_follow
  use summary_text, only: summary_record
  use text, only: either, es_text, to_text
  use transient, only: transient_march
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
      call text%figure('  events: ', 'count', sum(all%count()))
      call text%figure(': touched ', 'touched', sum([(all(i)%touched, i=1, size(all))]))
      call text%figure(', opened ', 'opened', sum(all%opened))
      call text%figure(', let go before they opened ', 'let_go', sum(all%let_go))
      call text%figure(', pressed again ', 'pressed', sum(all%pressed), rest='')
      call text%close()
      associate (r => run%d%transient, h => run%sys%shortest_limit)
        if (.not. r%adaptive) then
          if (h < actual_step(r%output_step, r%step)) call text%figure('  steps were divided while stops touched, the shortest '// &
            'contact allows ', 'step_in_contact', h, 3, rest=' s')
        end if
      end associate
      call tell_bound(run, text)
      if (march%files%events > most_events) call text%line('  events.txt has the first '//to_text(most_events)//' of them')
      call text%open('stops', '[')
      do i = 1, size(all)
        call one_stop(run, i, text)
      end do
      call text%close()
    end associate
  end subroutine stop_lines

  !> The current bound with the stiffness of contacts: that of the stop whose mode is the fastest. The largest eigenvalue of
  !> K + k g g' is at most the sum of that of K and of k g' M^-1 g.
  subroutine tell_bound(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    complex(wp) :: root                        ! of a contact's mode [1/s]
    real(wp) :: smallest, h                    ! [s]
    integer :: i, worst
    if (run%monitor%method == 0) return
    smallest = huge(1.0_wp)
    worst = 0
    do i = 1, run%sys%m%s%stops
      associate (x => run%sys%tally(i))
        if (.not. max(x%stiffness, x%damping) > 0.0_wp) cycle
        root = sqrt(cmplx(0.25_wp*x%damping**2 - x%stiffness - run%monitor%fastest**2, 0.0_wp, wp))
        h = min(run%monitor%smallest, step_of(run%monitor%method, [-0.5_wp*x%damping + root, -0.5_wp*x%damping - root]))
        if (h >= smallest) cycle
        smallest = h
        worst = i
      end associate
    end do
    if (worst == 0) return
    call text%figure('  smallest current bound of the step while stops touched: ', 'smallest_bound_in_contact', smallest, 4)
    call text%line(' s (stop "'//trim(run%sys%m%s%forces(run%sys%m%s%switching(worst))%item%name)//'")')
  end subroutine tell_bound

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
      call text%member('name', json_text(trim(f%name)))
      call text%figure('  stop "'//trim(f%name)//'": contacts ', 'touched', sum(x%touched))
      if (x%count() == 0 .and. .not. x%depth > 0.0_wp) then
        call text%line('')
        call text%close()
        return
      end if
      if (all(x%touched > 0)) call text%words%add(' ('//to_text(x%touched(1))//' at the upper limit)')
      call text%member('touched_upper', to_text(x%touched(1)))
      if (x%count() > 0) then
        call text%figure(', events from ', 'first', x%first, 6)
        call text%figure(' s to ', 'last', x%last, 6)
        call text%words%add(' s')
      end if
      call text%figure('; largest force ', 'largest_force', x%force, 4)
      if (f%row > 0) then
        call text%figure(' '//unit//', impulse ', 'largest_impulse', x%impulse, 4)
        call text%figure(' '//unit//'s; lost ', 'lost', lost, 4)
      else
        call text%figure(' '//unit//', penetration ', 'largest_penetration', x%depth, 4)
        call text%figure(either(' rad', ' m', f%angular)//'; lost ', 'lost', lost, 4)
      end if
      call text%words%add(' J')
      if (x%fewest < huge(1)) then
        call text%figure('; shortest contact ', 'shortest_contact', x%briefest, 3)
        call text%figure(' s, steps in it ', 'steps_of_shortest_contact', x%fewest, rest='')
      else
        call text%line('')
      end if
      call text%close()
      call judge(run, i, text)
    end associate
  end subroutine one_stop

  !> Warns of contacts that a body's mesh or modes cannot follow, and of a stop that a drive presses.
  subroutine judge(run, i, text)
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
        call warn(run, 'a contact with stop "'//trim(f%name)//'" lasts'//es_text(x%briefest, 2)//' s, '//limit//': its '// &
                  'force is not converged (more elements or modes, or a softer stop)', text)
      end do
      if (x%mass < huge(1.0_wp) .or. .not. x%depth > 0.0_wp) return
      work = run%sys%ev
      if (mass_at(m, work, m%s%switching(i)) < huge(1.0_wp)) return
      if (len(drives_against(m, work)) == 0) return
      call warn(run, 'stop "'//trim(f%name)//'" is pressed by drive'//drives_against(m, work)//', which moves on against '// &
                'any force: up to '//to_text(x%force)//either(' Nm', ' N', f%angular), text)
    end associate
  end subroutine judge
end module stop_words

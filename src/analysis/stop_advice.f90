!> Steps that contacts with the stops of a scene need, by an example: the speeds at which they will touch are not yet known.
module stop_advice
  use kinds, only: wp, pi
  use contact_mass, only: mass_at, drives_against
  use dynamics, only: evaluate_start
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use stops, only: example_depth, share_of_contact, stop_model
  use summary_text, only: summary_record
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: advise_stops, cannot_follow

contains

  !> A line for each stop; nothing where there is none.
  subroutine advise_stops(m, ev, q, text)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions [m, rad]
    type(summary_record), intent(inout) :: text
    type(evaluation) :: work
    integer :: i
    if (m%s%stops == 0) return
    work = ev
    call evaluate_start(m, work, q)
    call text%line('')
    call text%line('stops (yielding ones at a penetration of '//to_text(100*example_depth)//' % of the size, or '// &
                   to_text(example_depth)//' rad)')
    call text%open('stop_examples', '[')
    do i = 1, m%s%stops
      call one_stop(m, work, i, text)
    end do
    call text%close()
    call text%line('  dopri5 and radau with a tolerance take such steps only where they are needed; fixed steps are divided there')
  end subroutine advise_stops

  !> Says, as part of a sentence, that a marker's body cannot follow a contact, which lasts less than half a period of the highest
  !> frequency that the body carries. Empty: it can.
  pure function cannot_follow(m, marker, time) result(text)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: marker
    real(wp), intent(in) :: time               !! that the contact lasts [s]
    character(:), allocatable :: text
    text = ''
    if (m%s%markers(marker)%body == 0) return
    associate (body => m%s%bodies(m%s%markers(marker)%body))
      if (.not. body%flexible) return
      if (time < pi/max(body%basis%top_frequency, sqrt(tiny(1.0_wp)))) text = 'less than half a period of what the mesh or '// &
        'modes of body "'//trim(body%name)//'" can carry ('//to_text(body%basis%top_frequency)//' rad/s)'
    end associate
  end function cannot_follow

  !> Stiffness, speed at touching, length and steps of a contact as deep as the example.
  subroutine one_stop(m, ev, i, text)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev      !! evaluated
    integer, intent(in) :: i                   !! its number among those that switch
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: limit, unit_of_mass
    integer :: side
    real(wp) :: mass, depth, stiffness, speed, time   ! [kg], [m], [N/m], [m/s] or [kg m2], [rad], [N m/rad], [rad/s]; [s]
    mass = mass_at(m, ev, m%s%switching(i))
    call text%open('', '{')
    select type (f => m%s%forces(m%s%switching(i))%item)
    class is (stop_model)
      unit_of_mass = either(' kg m2', ' kg', f%angular)
      depth = f%scaled(example_depth)
      stiffness = f%stiffness_at(depth)
      call text%say('  stop "{name='//trim(f%name)//'}": ')
      if (f%rigid) call text%say('rigid')
      if (.not. f%rigid) call text%say('stiffness {stiffness}'//either(' Nm/rad', ' N/m', f%angular), [stiffness])
      if (f%rigid .and. mass < huge(1.0_wp)) then
        call text%say(', met by {mass}'//unit_of_mass, [mass])
      else if (mass < huge(1.0_wp)) then
        speed = sqrt(2*stiffness*depth**2/(f%exponent*(f%exponent + 1)*mass))
        time = f%impact_time(mass, speed)
        call text%say(', against {mass}'//unit_of_mass//'; a contact from {speed}'//either(' rad/s', ' m/s', f%angular)// &
                      ' lasts {contact} s and takes steps of {contact_step} s', [mass, speed, time, share_of_contact*time])
        do side = 1, 2
          limit = cannot_follow(m, merge(f%ia, f%ib, side == 1), time)
          if (len(limit) > 0) call text%say(new_line('a')//'    warning: that is '//limit)
        end do
      else
        call text%say('; its force moves nothing')
        if (len(drives_against(m, ev)) > 0) call text%say(', for what it limits is prescribed by drive'//drives_against(m, ev))
      end if
    end select
    call text%line('')
    call text%close()
  end subroutine one_stop
end module stop_advice

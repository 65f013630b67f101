!> Lines of the summary about the energy that friction of joints, terms of materials and damped springs dissipated.
module loss_words
  use kinds, only: wp
  use scene_model, only: scene
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use switching, only: element_name
  use text, only: either
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: friction_lines, loss_lines

contains

  !> A line for each joint with friction.
  subroutine friction_lines(run, text)
    type(run_state), intent(in) :: run
    type(summary_record), intent(inout) :: text
    integer :: i
    if (.not. allocated(run%sys%friction)) return
    if (size(run%sys%friction) == 0) return
    call text%open('friction', '[')
    do i = 1, size(run%sys%friction)
      call one_joint(run, i, text)
    end do
    call text%close()
  end subroutine friction_lines

  !> One joint: how far it slid, the energy lost, how long it was at rest.
  subroutine one_joint(run, i, text)
    type(run_state), intent(in) :: run
    integer, intent(in) :: i                   !! its number among those with friction
    type(summary_record), intent(inout) :: text
    real(wp) :: lost                           ! [J]
    real(wp) :: slid                           ! [m] or [rad]
    associate (m => run%sys%m, x => run%sys%friction(i))
      associate (row => m%s%constraints(m%s%permanent + i)%item)
        lost = run%y(2*m%s%nq + m%s%nz + m%s%nzd + 2 + row%switch_number)
        slid = x%slid
        call text%open('', '{')
        call text%line('  friction of '//either('stop', 'joint', row%parent > m%s%permanent)//' "{name='//trim(row%name)// &
          '}": slid {slid 4}'//either(' rad', ' m', row%angular)//', lost {lost 4} J; times that it came to rest {sticks #}, '// &
          'broke away {slips #}, turned without rest {turns #}; at rest {time_at_rest 4} s'// &
          either(', with at most {largest_share 4} of its limit', '', x%rest > 0.0_wp), &
          [real(wp) :: slid, lost, x%sticks, x%slips, x%turns, x%rest, x%share])
        if (x%unknown > 0.0_wp) call text%line('    its share of the load is not determined by rigid bodies, as others hold '// &
                                               'the same motion, during {undetermined 4} s', [x%unknown])
        call text%close()
      end associate
    end associate
  end subroutine one_joint

  !> A line for each material, with all its terms, and for each damped spring.
  subroutine loss_lines(run, y, switching, text)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: y(:)               !! (ny) state with the losses [m, rad], [m/s, rad/s], [J]
    logical, intent(in) :: switching           !! a line for each stop and each joint with friction as well
    type(summary_record), intent(inout) :: text
    type(viscoelastic_terms) :: law
    character(:), allocatable :: words
    real(wp), allocatable :: values(:)         ! numbers of layer and term [-] and energy [J]
    integer :: i
    associate (s => run%sys%m%s)
      if (size(s%losses) + merge(s%elements, 0, switching) == 0) return
      call text%open('losses', '[')
      do i = 1, merge(s%elements, 0, switching)
        if (i > s%stops .and. i <= size(s%switching)) cycle   ! functions of motion lose nothing
        words = 'stop'
        if (i > s%stops) then
          associate (row => s%constraints(s%permanent + i - size(s%switching))%item)
            words = 'friction of '//either('stop', 'joint', row%parent > s%permanent)
          end associate
        end if
        call text%item('  lost in '//words//' "{element='//element_name(run%sys%m, i)//'}": {lost 4} J', &
                       [y(2*s%nq + s%nz + s%nzd + 2 + i)])
      end do
      do i = 1, size(s%losses)
        associate (cause => s%losses(i), lost => y(s%ny - size(s%integrated) - size(s%losses) + i))
          if (cause%spring > 0) then
            words = '  lost in spring "{spring='//trim(s%forces(cause%spring)%item%name)//'}": {lost 4} J'
            values = [lost]
          else
            law = law_of(s, cause%material)
            values = [merge(cause%term, cause%term - law%second, cause%term <= law%second)*1.0_wp, lost]   ! among its kind
            words = ''
            if (cause%layer > 0) then
              words = 'layer {layer #} of body "{body='//trim(s%bodies(cause%body)%name)//'}", '
              values = [real(wp) :: cause%layer, values]
            end if
            words = '  lost in '//words//'material "{material='//trim(s%materials(cause%material))//'}": {kind='// &
                    trim(law%words(cause%term))//'} term {term #}: {lost 4} J'
          end if
          call text%item(words, values)
        end associate
      end do
      call text%close()
    end associate
  end subroutine loss_lines

  !> The law of a material that a body has.
  pure type(viscoelastic_terms) function law_of(s, material) result(law)
    type(scene), intent(in) :: s
    integer, intent(in) :: material
    integer :: b, r
    do b = 1, size(s%bodies)
      do r = 1, size(s%bodies(b)%segments)
        if (s%bodies(b)%segments(r)%material == material) law = s%bodies(b)%segments(r)%law
      end do
    end do
  end function law_of
end module loss_words

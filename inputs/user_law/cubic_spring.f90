!> Cubic spring f = k3 z**3 as a law of one's own, in Fortran. The functions are documented in nhbm_user_law.h.
!>
!>     gfortran -O2 -shared -fPIC -o cubic_f.so cubic_spring.f90
module cubic_spring
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_int, c_ptr
   implicit none
   private
   public :: cubic_f_evaluate, cubic_f_info

   integer(c_int), parameter :: api_version = 1                       ! NHBM_USER_LAW_API of nhbm_user_law.h

   !> nhbm_law_info_t
   type, bind(c) :: law_info_t
      integer(c_int) :: api_version, n_coordinates, n_parameters, needs_velocity, degree
      real(c_double) :: length_scale
   end type law_info_t

contains

   integer(c_int) function cubic_f_info(info) bind(c)
      type(law_info_t), intent(inout) :: info

      info%api_version = api_version
      info%n_coordinates = 1
      info%n_parameters = 1                                           ! k3 [N/m3]
      info%needs_velocity = 0
      info%degree = 3
      cubic_f_info = 0
   end function cubic_f_info

   integer(c_int) function cubic_f_evaluate(n_samples, n_coordinates, stride, z, v, n_parameters, parameters, f, df_dz, &
                                            df_dv) bind(c)
      integer(c_int), value :: n_samples, n_coordinates, stride, n_parameters
      real(c_double), intent(in) :: z(stride, n_coordinates), parameters(n_parameters)
      type(c_ptr), value :: v, df_dz, df_dv                           ! NULL where there is none
      real(c_double), intent(inout) :: f(stride, n_coordinates)
      real(c_double), pointer :: slope(:, :, :)

      associate (k3 => parameters(1), n => n_samples)
         f(:n, 1) = k3*z(:n, 1)**3
         if (c_associated(df_dz)) then
            call c_f_pointer(df_dz, slope, [stride, n_coordinates, n_coordinates])
            slope(:n, 1, 1) = 3.0_c_double*k3*z(:n, 1)**2
         end if
      end associate
      cubic_f_evaluate = 0
   end function cubic_f_evaluate
end module cubic_spring
